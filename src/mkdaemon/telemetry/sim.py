"""The simulator's own values: the true state and the active faults. Never read by flight code."""

from enum import StrEnum

from pydantic import Field

from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Command, Stamped, Telemetry


class SimTruth(Stamped):
    """The simulated aircraft as it really is."""

    t: float
    """Simulated time [s]."""
    position_enu: tuple[float, float, float]
    """Centre of gravity relative to the world's origin [m]."""
    velocity_enu: tuple[float, float, float]
    """[m/s]."""
    enu_from_flu: tuple[float, float, float, float]
    """Orientation as a quaternion (w, x, y, z)."""
    rates: tuple[float, float, float]
    """Body rates about forward, left, up [rad/s]."""
    wind_enu: tuple[float, float, float]
    """Velocity of the air [m/s]."""
    airborne: bool
    """The legs do not touch."""
    crashed: bool
    """Broken, and why in `crash_reason`."""
    crash_reason: str
    """Empty while whole."""
    motors_running: bool
    """The FlightCtrl drives the motors."""
    controlled: bool
    """External control acted on the last receiver frame."""
    gate_open: bool
    """The pilot's switch lets external control through."""
    motor_setpoints: tuple[int, int, int, int]
    """[count], motors 1 to 4."""
    port: str = ""
    """Pseudo terminal that the simulator serves, on the machine of `stamp.boot`; empty for none."""
    pilot: str = ""
    """What the simulated pilot does, or waits for, after "the pilot"."""


class ScenePose(Telemetry):
    """Pose of another simulator's aircraft, which `mkdaemon sim --scene-only` renders; a `SimTruth` is one."""

    t: float
    """Simulated time [s]; moves the target, and paces the images; may restart."""
    position_enu: tuple[float, float, float]
    """Body origin relative to the world's origin, where the target lies unless it is configured elsewhere [m]."""
    enu_from_flu: tuple[float, float, float, float]
    """Orientation as a quaternion (w, x, y, z)."""
    velocity_enu: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Blurs the image [m/s]."""
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Body rates about forward, left, up; blur the image [rad/s]."""
    stamp: Stamp
    """Time of the pose, within half a second of our clock. The time of arrival is not used: under load it is late."""


class RunningFault(Telemetry):
    """One fault that runs."""

    values: dict[str, float | str]
    """Its parameters."""
    began: float
    """Simulated time of its start [s]."""
    ends: float | None
    """Simulated time of its end [s]; None when it lasts until it is stopped."""


class SimFaults(Stamped):
    """All faults that run."""

    t: float
    """Simulated time [s]."""
    active: dict[str, RunningFault]
    """By name."""


class FaultAction(StrEnum):
    """Action on a fault."""

    START = "start"
    STOP = "stop"
    CLEAR = "clear"
    """Stop all of them."""
    LIST = "list"


class FaultRequest(Command):
    """Ask the simulator for a fault."""

    action: FaultAction = Field(default=FaultAction.START, strict=False)
    """What to do."""
    name: str = ""
    """Which fault; `mkctl sim faults` lists them."""
    duration: float | None = Field(default=None, gt=0.0)
    """How long it lasts [s]; unset takes the fault's own."""
    values: dict[str, float | str] = Field(default_factory=dict)
    """Its parameters; those left out take their defaults."""
