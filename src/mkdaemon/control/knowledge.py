"""All that the checks before a flight look at."""

from __future__ import annotations

from dataclasses import dataclass

from mkdaemon.config.control import LeaseConfig
from mkdaemon.control.activeset import UNREAD, ActiveSet
from mkdaemon.control.estimator.model import ModelUnknown
from mkdaemon.control.motionmatch import Match
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ControlLine
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.state import Battery, Flight, Pilot
from mkdaemon.telemetry.vision import VisionStats


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """All that the checks look at.

    Attributes:
        now: [s].
        lease: what the operator has accepted.
        hover_gas: throttle that carries the aircraft [count of 254].
        line: what the line can take.
        has_guard: the guard is there.
        link: the verdict on the line; None before the first.
        health: its measurements; None before the first.
        active_set: the FlightCtrl's parameter set.
        flight: what the aircraft does; None where nobody says so.
        pilot: reception; None where nobody says so.
        battery: None where nobody says so.
        highest_voltage: that it had since the port was opened [V]; the cells are counted by it.
        eyes: what each camera last said of itself.
        contradicting: cameras whose poses contradict those of the others.
        target_age: time since the newest image of a target [s]; None where there was none.
        stamps: do camera and boards tell of the same motion; None where nothing moved.
        free_disk: where the recorder writes [bytes]; None where nobody looked.
        model: why the model of the aircraft is not known from its set; None where it is.
        loop: why the control loop must not be flown; None where it is safe.
        is_loop_known: that has been computed.
    """

    now: float
    lease: LeaseConfig
    hover_gas: float
    line: ControlLine
    has_guard: bool = True
    link: LinkState | None = None
    health: LinkHealth | None = None
    active_set: ActiveSet = UNREAD
    flight: Flight | None = None
    pilot: Pilot | None = None
    battery: Battery | None = None
    highest_voltage: float = 0.0
    eyes: tuple[VisionStats, ...] = ()
    contradicting: tuple[str, ...] = ()
    target_age: float | None = None
    stamps: Match | None = None
    free_disk: float | None = None
    model: ModelUnknown | None = None
    loop: CommandRejectedError | None = None
    is_loop_known: bool = True
