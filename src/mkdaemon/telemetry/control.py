"""The lease, the phase of control, and what is sent to the aircraft."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from typing import Final, Self

from mkdaemon.telemetry.base import Stamped, Telemetry
from mkdaemon.telemetry.tone import Tone, ToneEnum


class Trait(Enum):
    """Properties of a phase."""

    IN_FLIGHT = auto()
    """Stick frames are sent."""
    STREAMED = auto()
    """The newest setpoint is followed."""
    ABORTABLE = auto()
    """An abort changes what is flown."""


NEVER_TAKEN: Final = "no lease was requested yet"
"""Reason before the first lease: it says no more than the words of the phase."""


class Phase(StrEnum):
    """Phase of control; the ladder of docs/safety.md. This is the only table of phases.

    Attributes:
        words: shown for it; `{holder}` is the holder of the lease.
        tone: how good it is.
        traits: what is true of it.
    """

    words: str
    tone: Tone
    traits: frozenset[Trait]

    def __new__(cls, word: str, words: str, tone: Tone, *traits: Trait) -> Self:
        """Declare one."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.words, member.tone, member.traits = words, tone, frozenset(traits)
        return member

    FREE = "free", "no client holds the lease", Tone.NOTE
    """No client holds the lease; nothing is sent."""
    LEASED = "leased", "{holder} waits to fly", Tone.NOTE
    """Someone holds it; nothing is sent until a live, neutral stream has been seen."""
    FLYING = "flying", "{holder} flies", Tone.OK, Trait.IN_FLIGHT, Trait.STREAMED, Trait.ABORTABLE
    """Stick frames are sent."""
    STALE = (
        *("stale", "{holder} is silent: neutral sticks", Tone.BAD),
        *(Trait.IN_FLIGHT, Trait.STREAMED, Trait.ABORTABLE),
    )
    """The setpoint is too old: neutral sticks at hover throttle are sent."""
    UNANSWERED = (
        *("unanswered", "the sticks have no answer: the pilot flies", Tone.BAD),
        *(Trait.IN_FLIGHT, Trait.ABORTABLE),
    )
    """The aircraft does not answer its sticks, so the pilot flies it: neutral sticks at hover throttle are sent."""
    ABORTED = "aborted", "aborted: it holds or flies level", Tone.WARN, Trait.IN_FLIGHT
    """A manoeuvre was stopped: the aircraft holds its place where a target is in sight, else it is level; until its
    holder ends the abort."""
    LANDING = "landing", "battery low: it lands by itself", Tone.WARN, Trait.IN_FLIGHT, Trait.ABORTABLE
    """The battery is low: the aircraft lands on the target in sight, whatever is streamed."""
    RELEASING = "releasing", "released: the pilot has it", Tone.WARN
    """A release is under way; no setpoints are sent."""

    @property
    def is_in_flight(self) -> bool:
        """Whether stick frames are sent."""
        return Trait.IN_FLIGHT in self.traits

    @property
    def is_streamed(self) -> bool:
        """Whether the newest setpoint is followed."""
        return Trait.STREAMED in self.traits

    @property
    def may_be_aborted(self) -> bool:
        """Whether an abort changes what is flown."""
        return Trait.ABORTABLE in self.traits


class Obstacle(StrEnum):
    """Reason for which the link takes no stick frame now; the values are tokens of refusals."""

    LINK_DOWN = "link_down"
    """The port is not open."""
    RECORDING = "recording"
    """A recording plays."""
    READ_ONLY = "read_only"
    """It is not known which external control this aircraft reads, if any."""
    RELEASING = "releasing"
    """A release is under way."""
    UNCONFIRMED = "unconfirmed"
    """The last release is not confirmed yet, and a stick frame would keep an old command alive."""
    DEAF = "board_deaf"
    """A board works on a request and does not listen."""


class Outcome(StrEnum):
    """Outcome of a manoeuvre that ended by itself."""

    LANDED = "landed"
    """The feet stand on the target."""
    LANDED_ASIDE = "landed_aside"
    """It came down, but nothing shows that it stands on the target."""
    NO_TARGET = "no_target"
    """No target was in sight."""
    SIGHT_LOST = "sight_lost"
    """The target was out of sight for too long."""
    TAKE_OFF_ABORTED = "take_off_aborted"
    """A take-off was aborted before an image showed the aircraft off the ground."""
    TIPPED = "tipped"
    """A take-off tipped over on the ground."""
    NOT_LIFTED = "not_lifted"
    """No image showed the aircraft off the ground."""


class CauseKind(StrEnum):
    """Causes that prevent a flight from continuing. This is the only table of causes.

    Attributes:
        words: shown for it; `{seconds}`, `{count}`, `{of}` and `{detail}` are those of `Cause`.
    """

    words: str

    def __new__(cls, value: str, words: str) -> Self:
        """A member with its words."""
        member = str.__new__(cls, value)
        member._value_, member.words = value, words
        return member

    NO_POSE = "no_pose", "no pose for {seconds:.1f} s"
    """No image has given a pose of the target that is followed."""
    REFUSED_IN_VIEW = "refused_in_view", "tag in view, {count} poses refused {detail}"
    """A tag of the target is decoded, and a check refuses what is measured."""
    REFUSED = "refused", "{count} poses refused {detail}"
    """A check refuses what is measured, and no tag has been decoded."""
    CAMERA = "camera", "camera {detail}"
    """A camera delivers no images that can be used."""
    NO_ATTITUDE = "no_attitude", "attitude silent {seconds:.1f} s"
    """The boards report no attitude."""
    NEVER_ATTITUDE = "never_attitude", "no attitude was ever reported"
    """The boards have not reported an attitude since the port was opened."""
    UNANSWERED = "unanswered", "{count} of {of} link tests unanswered"
    """The line, or the board, loses what is sent."""


class Cause(Telemetry):
    """One link of the chain of causes in `control/status`."""

    kind: CauseKind
    """What is wrong."""
    text: str
    """The same in words."""
    seconds: float | None = None
    """Duration [s]; null where none applies."""
    count: int | None = None
    """Number of events; null where none applies."""

    @classmethod
    def of(cls, kind: CauseKind, *, seconds: float = 0.0, count: int = 0, of: int = 0, detail: str = "") -> Self:
        """Make a cause, and put it into words."""
        text = kind.words.format(seconds=seconds, count=count, of=of, detail=detail)
        return cls(kind=kind, text=text, seconds=seconds or None, count=count or None)


def trouble_words(causes: Sequence[Cause], releases_in: float | None) -> str:
    """A chain of causes and the time left before the release [s], as one line; empty without causes."""
    if not causes:
        return ""
    first, *others = (cause.text for cause in causes)
    why = f": {'; '.join(others)}" if others else ""
    left = "" if releases_in is None else f", releases in {releases_in:.1f} s"
    return f"{first.upper()}{left}{why}"


@dataclass(frozen=True, slots=True)
class ControlLine:
    """What the link accepts from the flight core.

    Attributes:
        layout: layout of external control this aircraft reads; None where it must not be steered.
        obstacle: why no stick frame can be sent now; None where one can.
        reason: why there is no layout; else what the link says about the line.
        shortest_step: least time between two stick frames that the boards can take [s].
    """

    layout: str | None = None
    obstacle: Obstacle | None = None
    reason: str = ""
    shortest_step: float = 0.01


class ReleaseOutcome(ToneEnum):
    """Outcome of a release. This is the only table of them."""

    CONFIRMED = "confirmed", "released, and the FlightCtrl confirmed it", Tone.OK
    """The board confirmed five frames."""
    NOT_OBSERVABLE = (
        "not_observable",
        "released; a confirmation cannot come this way (NaviCtrl between us and the FlightCtrl)",
        Tone.OK,
    )
    """Sent; no confirmation can come here."""
    UNCONFIRMED = (
        *(
            "unconfirmed",
            "released, but NOT confirmed: the line stays silent until the FlightCtrl ends external control (6 s)",
        ),
        Tone.BAD,
    )
    """A confirmation could have come and did not; what keeps the sticks alive is silenced."""
    NOT_SENT = "not_sent", "NOT sent, the line is down; it is the first thing sent when the line is back", Tone.BAD
    """No open port: the release is the first thing sent after opening."""


class ReleaseReport(Telemetry):
    """Report of a release: the answer to `do/release`."""

    status: ReleaseOutcome
    """How it ended."""
    sent: int
    """Frames sent that end external control."""
    confirmed: int
    """Of those, confirmed by the board."""
    reason: str
    """Why it was released."""

    @property
    def is_done(self) -> bool:
        """Whether it was confirmed, or cannot be."""
        return self.status in {ReleaseOutcome.CONFIRMED, ReleaseOutcome.NOT_OBSERVABLE}


@dataclass(frozen=True, slots=True)
class Progress:
    """The present manoeuvre and its progress.

    Attributes:
        manoeuvre: kind of the setpoint, the last word of its key.
        stage: where it stands, in words; empty for a setpoint that has no stages.
        is_done: what was asked for is reached, and held.
    """

    manoeuvre: str
    stage: str
    is_done: bool


class LeaseState(Telemetry):
    """The lease, as answered by `do/lease` and shown in `control/status`."""

    holder: str
    """Name of the client that holds the lease."""
    epoch: int
    """Every lease has its own; setpoints of any other are refused."""
    ttl: float
    """Life without renewal or setpoints [s]."""
    left: float
    """Time until it ends without a sign of life [s]."""


class LeaseProbe(Telemetry):
    """The answer to `probe`, which comes before taking the lease."""

    echo: str
    """To be sent back in `take`, at once."""


class LeaseGrant(LeaseState):
    """The lease as its holder alone sees it: the answer to taking it."""

    secret: str
    """Signs every setpoint (see Flying by sticks), and renews or gives back the lease. Never published."""
    setpoint_root: str = "setpoint"
    """Setpoints are put below it: `<setpoint_root>/stick`. Never published."""


class HolderGrant(LeaseGrant):
    """The same, and what the bus of this daemon knows beyond the flight core, whose answers are recorded."""

    takes_stamps: bool = False
    """A setpoint may say when it was sent (see Flying by sticks); an older daemon takes no such attachment."""


class StatusValue(Telemetry):
    """Authority and what it does."""

    phase: Phase
    """Phase of control; docs/modes.md."""
    reason: str
    """Reason of the phase, one sentence."""
    causes: tuple[Cause, ...] = ()
    """Why there is no pose, in a flight by the target: the effect first, the root last; empty while there is one."""
    trouble: str = ""
    """The causes and the time left before the release, as one line; empty while nothing is wrong."""
    releases_in: float | None = None
    """Time until the aircraft is released, if nothing changes [s]; null while nothing is wrong."""
    lease: LeaseState | None
    """The client that may fly; null if there is none."""
    setpoint_age: float | None
    """Age of the setpoint in use [s]."""
    refused: int
    """Setpoints refused since the start."""
    aborts: int = 0
    """Aborts since the start; a setpoint with this number in `after_abort` ends the newest one."""
    external_control: str | None
    """Layout of stick frames this aircraft takes; null where control is not possible."""
    frames_handed_over: int = 0
    """Stick frames handed to the line since the start."""
    frames_sent: int = 0
    """Of those, written to the port."""
    frames_dropped: int = 0
    """Of those handed over, never written: replaced by a newer one, too old, or thrown away by a release."""
    frames_confirmed: int = 0
    """Of those sent, confirmed by the board, where it confirms any."""
    pose_age: float | None = None
    """Time since the newest pose of a target was seen [s]; null where none was."""
    manoeuvre: str | None = None
    """Kind of the setpoint whose sticks are sent, for example `takeoff`; null while none are."""
    stage: str = ""
    """Stage of a take-off or landing, in words."""
    is_done: bool = False
    """The setpoint is reached and held."""
    outcome: Outcome | None = None
    """How the last manoeuvre of the newest lease ended by itself; null while it has not."""
    poses_refused: int = 0
    """Invalid poses since the start: not finite, from the future, too old; the log names them."""
    hands: str = ""
    """The pilot's task now, one sentence; docs/flying.md."""
    pilots_throttle: float | None = None
    """The pilot's throttle while it is lower than ours, so that it counts [stick from the centre]: he must raise it;
    null while it is not, and where the board does not report its throttle."""


class ControlStatus(StatusValue, Stamped):
    """Authority and what it does: `control/status`, on every change and once a second.

    What is new with every stick frame is published with it, and only counted here: sticks, the setpoint's age and the
    frame's number in `control/output`, state and age of the image in `control/estimate`, the rest in `control/error`.
    """


class EstimateValue(Telemetry):
    """The aircraft in the frame of the target it flies against; z is up."""

    target: str
    """Name of the target."""
    position: tuple[float, float, float]
    """Body origin from the middle of the target [m]."""
    velocity: tuple[float, float, float]
    """Relative to the target [m/s]."""
    tilt: tuple[float, float]
    """True tilt towards x and y, the way it accelerates [rad]."""
    disturbance: tuple[float, float]
    """Acceleration towards x and y that the model does not explain: wind, a moving target [m/s2]."""
    yaw: float
    """Heading of the forward axis, counter-clockwise from x [rad]."""
    hover_throttle: float
    """Throttle that carries the aircraft [stick from the centre]."""
    position_sd: tuple[float, float, float]
    """Standard deviation of the position [m]."""
    covariance: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]] | None = None
    """For x, y and z: variance of the position [m2], its covariance with the velocity [m2/s], variance of the velocity
    [m2/s2]. The axes are estimated apart, so nothing else is correlated."""
    image_age: float
    """Time since the newest image that was used [s]."""
    innovation: float
    """Mean squared surprise of the images over what was expected; about 1 when all is well."""
    caution: float = 0.0
    """How little the model of the aircraft counts against the images: 1 at first, 0 once their surprises are as small
    as it lets expect."""
    stick_gain: float = 1.0
    """Tilt that a stick count asks for, over the model's; found in flight, 1 while it may be the model's."""
    stick_filter: float = 0.0
    """Time constant of the FlightCtrl's stick filter [s]: that of its release, unless the flight shows another."""
    uplink: float = 0.0
    """From the moment a stick frame is written until the boards have it [s]: measured on the line, then in flight."""
    attitude_age: float = 0.0
    """Of a reported attitude when it arrives [s]: measured on the line, then in flight."""
    contradicting: tuple[str, ...] = ()
    """Cameras whose images contradict those of the others and are not used."""


class ControlEstimate(Stamped, EstimateValue):
    """The flight core's estimate: `control/estimate`, with every stick frame in the air; nothing on the ground."""


class ErrorValue(Telemetry):
    """Distance of the aircraft from its goal: estimate minus goal."""

    manoeuvre: str
    """Kind of the setpoint."""
    goal: tuple[float, float, float]
    """Where it is to be, from the middle of the target; of a velocity, the point it flies to [m]."""
    error_pad: tuple[float, float, float]
    """In the axes of the target [m]."""
    error_body: tuple[float, float, float]
    """Forward, left, up; turned level [m]."""
    error_yaw: float | None
    """Heading less wanted heading, nose left positive [rad]; null where none is wanted."""


class ControlError(Stamped, ErrorValue):
    """The error to the setpoint: `control/error`, with every stick frame of an autonomous flight in the air."""


class ControlFence(Stamped):
    """Limits of autonomous flight; setpoints outside are moved to the surface: `control/fence`."""

    radius: float
    """Largest horizontal distance from the middle of the target [m]."""
    height: float
    """Largest height above it [m]."""
    floor: float
    """Least height above it; landings are exempt [m]."""


class Gains(Telemetry):
    """The horizontal loop: model of the aircraft, gains, and margins: `do/gains`."""

    degrees_per_count: float
    """Tilt that a stick count asks for [deg]."""
    a1: float
    """Proportional gain of the attitude loop [1/s]."""
    a2: float
    """Integral gain of the attitude loop [1/s2]."""
    leak: float
    """Time constant with which the FlightCtrl's tilt follows its accelerometers [s]."""
    stick_filter: float
    """Of the sticks, in the FlightCtrl [s]."""
    uplink: float
    """From the transmission of a stick frame to its effect [s]."""
    gains: dict[str, float]
    """Tilt asked for, per metre, m/s, radian, radian second and rad/s of error."""
    radius: float
    """Spectral radius of the closed loop over a control period; below 1 is stable."""
    gain_margin: tuple[float, float]
    """Stick gain of the aircraft over the model's between which the loop is stable; tried from 0.05 to 20."""
    delay_margin: float
    """Delay beyond the model's up to which it is stable [s]; tried up to 24 control periods."""
    rest_level: float
    """Horizontal distance from its goal with which a flight on the model ends, behind the configured limits [m]."""
    rest_height: float
    """The same, vertically [m]."""
    needed_gain: tuple[float, float] = (1.0, 1.0)
    """Stick gains over the model's that it has to bear: the range of `gain_margin` must hold this one."""
    needed_delay: float = 0.0
    """Least `delay_margin` [s]."""
    farthest_rest: float = 1e9
    """Largest `rest_level` and `rest_height` [m]."""

    @property
    def is_safe(self) -> bool:
        """The loop bears what it has to bear."""
        low, high = self.gain_margin
        return (
            self.radius < 1.0
            and low <= self.needed_gain[0]
            and high >= self.needed_gain[1]
            and self.delay_margin >= self.needed_delay
            and max(self.rest_level, self.rest_height) <= self.farthest_rest
        )


class ControlOutput(Stamped):
    """One stick frame at the moment it was handed to the line: `control/output`. FLU signs, after the limiter.

    Not every one leaves: `control/status` counts those sent, confirmed and dropped, `tx/fc/extern_control` shows them.
    """

    epoch: int
    """The lease it stands on."""
    sequence: int
    """The setpoint it came from."""
    frame: int
    """Its number on the wire, 1..255; the board's confirmation repeats it."""
    age: float
    """Age of that setpoint [s]."""
    pitch: int
    """Nose down positive [stick]."""
    roll: int
    """Right side down positive [stick]."""
    yaw: int
    """Nose left positive [stick]."""
    throttle: int
    """More lift positive [stick from the centre]."""
    limited: bool
    """Whether the limiter changed the wanted sticks."""
    wanted: tuple[float, float, float, float] | None = None
    """Pitch, roll, yaw and throttle asked for, before the limiter [stick]."""
