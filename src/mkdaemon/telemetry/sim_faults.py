"""Faults of the simulator by name: one table says what exists, what it takes and who acts on it."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final


class Reader(StrEnum):
    """The part of the simulator that acts on a fault."""

    WORLD = "world"
    BOARDS = "boards"
    RADIO = "radio"
    SCENE = "scene"


@dataclass(frozen=True, slots=True)
class FaultNumber:
    """A number a fault takes, with its range and unit."""

    default: float
    low: float
    high: float
    unit: str
    help: str
    whole: bool = False
    """It counts something: no fractions."""


@dataclass(frozen=True, slots=True)
class FaultChoice:
    """A word a fault takes."""

    default: str
    choices: tuple[str, ...]
    help: str


FaultParameter = FaultNumber | FaultChoice
FaultValue = float | str


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """One fault.

    Attributes:
        reader: who acts on it.
        effect: what happens, in one sentence.
        parameters: what it takes.
        duration: how long it lasts unless the request says so [s]; None lasts until stopped.
        once: an event: its reader takes it and it is over.
    """

    reader: Reader
    effect: str
    parameters: dict[str, FaultParameter] = field(default_factory=dict)
    duration: float | None = None
    once: bool = False


def _number(default: float, low: float, high: float, unit: str, help_: str) -> FaultNumber:
    return FaultNumber(default, low, high, unit, help_)


MOCAP_KINDS: Final = (
    *("silent", "off", "late", "late_unsaid", "mirrored", "mirrored_place", "wrong_up", "other_body", "neighbour"),
    "frozen",
)
"""What a motion capture system may do: see `mksim.physics.mocap`."""
FAULTS: Final[dict[str, FaultSpec]] = {
    "motor_weak": FaultSpec(
        Reader.WORLD,
        "One rotor gives only a share of its thrust.",
        {
            "motor": FaultNumber(1, 1, 4, "", "1 front, 2 rear, 3 right, 4 left", whole=True),
            "share": _number(0.8, 0.0, 1.0, "", "thrust left"),
        },
    ),
    "rc_lost": FaultSpec(Reader.WORLD, "The receiver gets no signal from the transmitter."),
    "gate_closed": FaultSpec(Reader.WORLD, "The pilot's external-control switch is closed."),
    "gps_switch": FaultSpec(
        Reader.WORLD,
        "The pilot turns the GPS switch, and leaves pitch and roll to the NaviCtrl while it is not at free.",
        {"to": FaultChoice("home", ("free", "hold", "home"), "new position of the switch")},
    ),
    "wind_gust": FaultSpec(
        Reader.WORLD,
        "A single gust in addition to the wind.",
        {
            "speed": _number(4.0, 0.0, 15.0, "m/s", "peak"),
            "from_deg": _number(0.0, 0.0, 360.0, "deg", "direction of origin, clockwise from north"),
        },
        duration=2.0,
    ),
    "battery_drop": FaultSpec(
        Reader.WORLD,
        "The pack loses voltage, as with a broken cell.",
        {"volts": _number(1.5, 0.0, 10.0, "V", "voltage lost")},
    ),
    "gps_lost": FaultSpec(Reader.WORLD, "The GPS receiver has no fix and no satellites."),
    "compass_bias": FaultSpec(
        Reader.WORLD,
        "The compass is deflected, as near steel.",
        {"deg": _number(30.0, -180.0, 180.0, "deg", "added to the heading, clockwise")},
    ),
    "imu_bias": FaultSpec(
        Reader.WORLD,
        "The gyros drift and the accelerometer has an offset.",
        {
            "rate_deg": _number(1.0, -30.0, 30.0, "deg/s", "added to the pitch and roll gyros"),
            "lean_deg": _number(2.0, -20.0, 20.0, "deg", "added to the accelerometer's pitch and roll"),
        },
    ),
    "mocap": FaultSpec(
        Reader.SCENE,
        "The motion capture system is wrong.",
        {"kind": FaultChoice("silent", MOCAP_KINDS, "what is wrong with its poses")},
    ),
    "link_cut": FaultSpec(
        Reader.RADIO,
        "The serial link carries nothing.",
        {"direction": FaultChoice("both", ("both", "to_board", "to_host"), "which way is cut")},
    ),
    "tag_covered": FaultSpec(
        Reader.SCENE,
        "Something lies on the landing target.",
        {"share": _number(1.0, 0.0, 1.0, "", "share of the target that is hidden")},
    ),
    "light_off": FaultSpec(
        Reader.SCENE,
        "The lamps fail.",
        {"share": _number(0.02, 0.0, 1.0, "", "light left")},
    ),
    "camera_off": FaultSpec(Reader.SCENE, "The camera delivers nothing."),
    "fc_reboot": FaultSpec(Reader.BOARDS, "The FlightCtrl restarts, in flight too.", once=True),
    "nc_reboot": FaultSpec(Reader.BOARDS, "The NaviCtrl restarts and loses its waypoints, in flight too.", once=True),
    "spi_lost": FaultSpec(Reader.BOARDS, "The NaviCtrl receives nothing from its FlightCtrl."),
    "nc_sd_stall": FaultSpec(Reader.BOARDS, "The NaviCtrl is busy with its SD card.", duration=2.0),
}
"""Every fault there is; keys, CLI, help and documentation are read from here."""
