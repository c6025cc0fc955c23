"""All that admission looks at: frozen, made once a tick, or when a client asks for something."""

from __future__ import annotations

from dataclasses import dataclass

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.activeset import KnownSet
from mkdaemon.control.admission.beginnings import Concern
from mkdaemon.control.estimator.model import ModelUnknown
from mkdaemon.control.motionmatch import Match
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ControlLine, Phase
from mkdaemon.telemetry.link import LinkHealth, LinkState
from mkdaemon.telemetry.procedure import ProcedureProgress
from mkdaemon.telemetry.state import Battery, Flight, Gps, Pilot, Position
from mkdaemon.telemetry.vision import VisionStats


@dataclass(frozen=True, slots=True)
class OwedLiveSet:
    """A live set of the FlightCtrl that must be proven before it is used.

    Attributes:
        slot: number of the set.
        verb: procedure that left it.
        detail: what is known about its recovery.
    """

    slot: int
    verb: str
    detail: str


@dataclass(frozen=True, slots=True)
class Work:
    """Work that keeps the boards busy.

    Attributes:
        running: the procedure under way; None for none.
        is_alone: whether it excludes flying.
        owed: the live set that has to be proven first; None for none.
        leases: how many clients are taking the lease at this moment.
    """

    running: ProcedureProgress | None = None
    is_alone: bool = False
    owed: OwedLiveSet | None = None
    leases: int = 0


ASIDE = 0.5
"""An aircraft stands on no target whose middle is farther aside [m]."""
NO_WORK = Work()
"""Nothing is under way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EntryEstimate:
    """The estimate's values for the entry conditions of a flight by the target.

    Attributes:
        target: name of the target that is followed.
        age: of its newest image [s].
        speed: against the target, up and down included [m/s].
        offset: from the middle of the target, over ground [m].
        height: above the target [m].
        sd: standard deviation of the worst known axis of the position, by the time the next image comes [m].
        clean: how long images have agreed with the model [s].
    """

    target: str
    age: float
    speed: float
    offset: float
    height: float
    sd: float
    clean: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """All that admission looks at; nothing has a default, so that nothing passes because it was forgotten.

    Attributes:
        cfg: what is configured.
        now: [s].
        phase: where authority stands.
        holder: of the lease; empty without one.
        lease_left: time until the lease ends without a sign of life [s].
        flown: the manoeuvre whose sticks are being sent; None while no stick frames are sent.
        work: what keeps the boards busy.
        line: what the line can take.
        has_guard: the guard is there.
        link: the verdict on the line; None before the first.
        health: its measurements; None before the first.
        active_set: the FlightCtrl's parameter set.
        motors_running: None where no message has said so lately.
        is_testing_motors: a motor test may be the reason that motors turn.
        flight: what the aircraft does; None if no board reports it.
        pilot: the receiver's quality; None if no board reports it.
        position: by GPS; None if not reported.
        gps: reception of satellites; None if not reported.
        battery: None if no board reports it.
        cells: of the battery; None where it has not been measured.
        are_cells_doubtful: it may have one more than its voltage shows.
        hover_gas: throttle that carries the aircraft [count of 254].
        gas_in_use: throttle that the FlightCtrl flies with [count of 254]; None where it does not tell.
        eyes: what each camera last said of itself.
        contradicting: cameras whose poses contradict those of the others.
        target_age: time since the newest image of a target [s]; None where there was none.
        paths: ids of the paths that are stored.
        in_sight: names of all targets that images have shown lately.
        entry: what the estimate says; None where there is none, or no manoeuvre can begin.
        is_touching: what is flown may touch the ground: a take-off not yet seen to fly, the end of a landing.
        unanswered: why the sticks of a flight by the target do not act, in words; empty where they may.
        stamps: whether camera and boards report the same motion; None if nothing moved or nothing was compared.
        free_disk: free space of the recorder's disk [bytes]; None if not measured.
        model: why the model of the aircraft is not known from its set; None where it is.
        loop: why the control loop must not be flown; None where it is safe.
    """

    cfg: ControlConfig
    now: float
    phase: Phase
    holder: str
    lease_left: float
    flown: Concern | None
    work: Work
    line: ControlLine
    has_guard: bool
    link: LinkState | None
    health: LinkHealth | None
    active_set: KnownSet
    motors_running: bool | None
    is_testing_motors: bool
    flight: Flight | None
    pilot: Pilot | None
    position: Position | None
    gps: Gps | None
    battery: Battery | None
    cells: int | None
    are_cells_doubtful: bool
    hover_gas: float
    gas_in_use: float | None
    eyes: tuple[VisionStats, ...]
    contradicting: tuple[str, ...]
    target_age: float | None
    paths: frozenset[str]
    in_sight: tuple[str, ...]
    entry: EntryEstimate | None
    is_touching: bool
    unanswered: str
    stamps: Match | None
    free_disk: float | None
    model: ModelUnknown | None
    loop: CommandRejectedError | None

    @property
    def is_receiver_lost(self) -> bool:
        """Whether the FlightCtrl is known to fly without the pilot's transmitter."""
        if self.flight is not None and self.flight.emergency_landing is not None:
            return self.flight.emergency_landing
        return self.pilot is not None and not self.pilot.has_signal

    @property
    def grounded(self) -> str:
        """Reason why the aircraft does not fly, by the boards' reports; empty if it may fly."""
        if self.motors_running is False:
            return "its motors are off"
        is_down = self.flight is not None and self.flight.is_flying is False
        return "the board says that it does not fly" if is_down else ""

    @property
    def is_free(self) -> bool:
        """Whether no client holds the lease or is taking it, and nothing flies."""
        return self.phase is Phase.FREE and not self.work.leases
