"""`python -m lab fuzz --core`: random events for the flight core, and what must hold whatever happens.

A toy aircraft obeys the sticks: thrust, tilt, ground. A client streams, changes its mind, dies; a pilot shuts the gate
and stops the motors; boards, cameras, line and guard say whatever they like. The invariants are those of
docs/safety.md: see `Breach`. Virtual time; a sequence takes about a second of processor time.
"""

from __future__ import annotations

import math
import multiprocessing
import random
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import Action, PublishError, PublishStatus, Release, SendSticks
from mkdaemon.control.activeset import UNREAD, ActiveSet, Gate, GateKind
from mkdaemon.control.core import FlightCore
from mkdaemon.control.estimator.model import GRAVITY, AircraftModel, Gap, ModelUnknown
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.events import (
    AbortAsked,
    ActiveSetRead,
    ClientGone,
    Event,
    FrameConfirmed,
    FrameSent,
    GuardActed,
    LeaseAsked,
    LineChanged,
    LinkVerdict,
    ModelKnown,
    MotorsReported,
    PoseSeen,
    ReleaseAsked,
    Released,
    Reply,
    SetpointAccepted,
    StateValue,
)
from mkdaemon.control.manoeuvres.land import LandingPhase
from mkdaemon.control.manoeuvres.take_off import TakeOffPhase
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, LeaseGrant, Obstacle, ReleaseOutcome
from mkdaemon.telemetry.link import LinkCondition, LinkState
from mkdaemon.telemetry.setpoint import (
    AttitudeSetpoint,
    HoldSetpoint,
    LandSetpoint,
    PositionSetpoint,
    Setpoint,
    SetpointFrame,
    StickSetpoint,
    TakeOffSetpoint,
    VelocitySetpoint,
)
from mkdaemon.telemetry.state import Attitude, Battery, Flight, GpsMode, Pilot
from mkdaemon.telemetry.vision import VisionPose

TELL_EVERY: Final = 10.0
"""Progress is written at most this often [s]."""
EVENTS: Final = 300
"""Of a sequence."""
PERIOD: Final = 0.02
"""Of the toy's physics, and of the client's stream [s]."""
IMAGES: Final = 3
"""Steps between two images."""
STAND: Final = 0.10
"""Height of the body above the target when the feet stand [m]."""
HOVER: Final = 125.0
"""Throttle that carries the toy [count of 254]."""
TILT: Final = math.radians(0.451)
"""Tilt that a stick count asks for [rad]."""
LAG: Final = 0.3
"""Of that tilt [s]."""
SLACK: Final = 3.0
"""Whole counts, error feedback, and the learnt hover throttle, above which nothing must lift standing feet [stick]."""
LATEST: Final = 0.06
"""Ticks are so far apart at most [s]: what is promised after a time may come so much later."""
LONGEST_STAGE: Final = {TakeOffPhase.IDLE: 4.0, TakeOffPhase.RAMP: 4.0, TakeOffPhase.FAILED: 2.0,
                        TakeOffPhase.CLIMB: 36.0, LandingPhase.COMMIT: 6.0, LandingPhase.DOWN: 1.5}  # fmt: skip
"""Of the stages that nobody waits in [s]; the whole landing ends in `LONGEST_LANDING`."""
LONGEST_LANDING: Final = 75.0
"""What a landing may wait for, and its way down from the fence [s]."""


class Breach(StrEnum):
    """What must never be."""

    EXCEPTION = "an exception, or a warning"
    LIMITS = "sticks beyond the limits of the configuration"
    NO_LEASE = "a stick frame that stands on no lease"
    NOT_NEUTRAL = "a setpoint is too old, and tilt or yaw are asked for"
    NOT_RELEASED = "nothing was streamed for longer than `release_after`, and stick frames go on"
    LIFTS = "feet that stand, no take-off, nobody's own sticks, and throttle above hover"
    ENDLESS = "a stage that does not end"
    UNTRUE = "what is reported is not what is flown"


@dataclass
class Sequence:
    """What one sequence came to.

    Attributes:
        seed: of it.
        breaches: what was found, each with the time and what was seen.
        flown: seconds in which stick frames were sent, by manoeuvre.
    """

    seed: int
    breaches: list[str] = field(default_factory=list)
    flown: dict[str, float] = field(default_factory=dict)


class Toy:
    """An aircraft that obeys: position [m], velocity [m/s], tilt [rad]; the pilot hovers it while nobody sends."""

    def __init__(self, height: float) -> None:
        self.place, self.velocity, self.tilt = [0.0, 0.0, height], [0.0, 0.0, 0.0], [0.0, 0.0]
        self.runs, self.gate_is_open = True, True
        self.sent: tuple[float, SendSticks] | None = None

    @property
    def stands(self) -> bool:
        """Whether the feet stand."""
        return self.place[2] <= STAND + 1e-6

    def step(self, now: float) -> None:
        """Move on by `PERIOD`."""
        frame = self.sent[1].counts if self.sent is not None and now - self.sent[0] < 0.5 else None
        if frame is None or not self.gate_is_open:
            lift = GRAVITY - 2.0 * self.velocity[2] if not self.stands else 0.0
            asked = [-0.3 * speed for speed in self.velocity[:2]]
        else:
            lift = GRAVITY * (max(frame.throttle + GAS_CENTRE, 0.0) / HOVER) ** 2
            asked = [TILT * frame.pitch, -TILT * frame.roll]
        lift *= self.runs
        for axis in (0, 1):
            self.tilt[axis] += (asked[axis] - self.tilt[axis]) * PERIOD / LAG
            self.velocity[axis] += (GRAVITY * math.tan(self.tilt[axis]) - 0.35 * self.velocity[axis]) * PERIOD
        self.velocity[2] += (lift - GRAVITY) * PERIOD
        for axis in range(3):
            self.place[axis] += self.velocity[axis] * PERIOD
        if self.place[2] <= STAND:
            self.place[2], self.velocity, self.tilt = STAND, [0.0, 0.0, max(self.velocity[2], 0.0)], [0.0, 0.0]


class Fuzz:
    """One sequence."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = random.Random(seed)
        self.found = Sequence(seed)
        self.cfg = ControlConfig()
        self.core = FlightCore(self.cfg, first_epoch=1000)
        self.toy = Toy(rng.choice((STAND, STAND, 1.0, 2.0)))
        self.now, self.steps, self.number, self.openings = 0.0, 0, 0, 1
        self.epoch, self.secret, self.sequence = 0, "", 0
        self.streamed: type[Setpoint] | None = None
        self.heard, self.newest = -math.inf, ""
        self.ends_abort = False
        self.told = {"images": True, "attitude": True, "flight": True, "battery": True, "gate": False}
        self.wrong = (0.0, 0.0, 0.0)
        self.second_camera: tuple[float, float, float] | None = None
        self.battery_is_low = False
        self.release_ends = math.inf
        self.stage: tuple[str, float] = ("", 0.0)
        self.up_at = 0.0
        self.landing_began: float | None = None
        self.events: tuple[Callable[[], None], ...] = (
            *[self._stream] * 8, *[self._wait] * 5, *[self._take] * 6, self._stop, self._abort, self._resume,
            self._release, self._return, self._die, self._gate, self._gate_told, self._motors, self._motors,
            self._blind, self._see, self._see, self._wrong, self._right, self._mute, self._tell, self._tell,
            self._camera, self._battery, self._model, self._line, self._link, self._guard, self._stand_still,
            self._receiver,
        )  # fmt: skip

    # -- the run --------------------------------------------------------------------------------------------------

    def run(self, events: int) -> Sequence:
        """Feed events, and look after every tick."""
        self._link_state(LinkCondition.UP)
        self.feed(LineChanged(ControlLine("v2")))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                for _ in range(events):
                    self.rng.choice(self.events)()
                    for _ in range(self.rng.choice((1, 1, 2, 4))):
                        self._pass()
        except Exception:  # whatever it is, it is the finding  # noqa: BLE001
            self._breach(Breach.EXCEPTION, traceback.format_exc(limit=-4))
        return self.found

    def feed(self, event: Event) -> Reply:
        """Tell the core."""
        return self.core.feed(event, self.now)

    def _pass(self) -> None:
        """One step of the toy, what boards and cameras say of it, a setpoint, and the ticks that are due."""
        self.now += PERIOD
        self.steps += 1
        self.toy.step(self.now)
        self.up_at = self.up_at if self.toy.stands else self.now
        self._boards()
        if self.steps % IMAGES == 0 and self.told["images"]:
            self._image("down", self.wrong)
            if self.second_camera is not None:
                self._image("forward", self.second_camera)
        if self.streamed is not None and self.epoch:
            self._put(self.streamed)
        if self.now >= self.release_ends:
            self.release_ends = math.inf
            self.feed(Released(self.rng.choice((*ReleaseOutcome, None))))
        for _ in range(4):
            if self.core.next_time() > self.now:
                break
            self._look(self.core.tick(self.now))

    def _boards(self) -> None:
        toy = self.toy
        if self.steps % 5 == 0 and self.told["flight"]:
            self.feed(MotorsReported(toy.runs))
            says = toy.runs if self.found.seed % 2 else not toy.stands
            self.feed(StateValue(self._made(Flight, motors_running=toy.runs, is_flying=says, gps_mode=GpsMode.FREE)))
        if self.steps % 2 == 0 and self.told["attitude"]:
            pitch, roll = toy.tilt[0], -toy.tilt[1]
            quaternion = (1.0, 0.0, 0.0, 0.0)
            self.feed(StateValue(self._made(Attitude, quaternion=quaternion, roll=roll, pitch=pitch, yaw=0.0)))
        if self.told["gate"]:
            fields: dict[str, Any] = {"rc_quality": 1.0, "has_signal": True, "is_gate_open": toy.gate_is_open}
            self.feed(StateValue(self._made(Pilot, **fields)))
        if self.steps % 10 == 0 and self.told["battery"]:
            low = self.battery_is_low
            self.feed(StateValue(self._made(Battery, voltage=12.0 if low else 16.0, is_low=low)))

    def _made(self, kind: type[Any], **fields: Any) -> Any:
        """A value with everything else unknown."""
        unknown = dict.fromkeys(kind.model_fields)
        return kind.model_construct(**(unknown | {"stamp": self._stamp(), "source": "nc/osd"} | fields))

    def _stamp(self) -> Stamp:
        return Stamp(monotonic=self.now, wall=self.now)

    def _image(self, camera: str, off: tuple[float, float, float]) -> None:
        x, y, z = (place + error for place, error in zip(self.toy.place, off, strict=True))
        if math.hypot(x, y) > 1.2 * z or z < 0.02:
            return
        pose = self._made(
            VisionPose,
            stamp=Stamp(monotonic=self.now - 0.06, wall=self.now),
            camera=camera,
            target="pad",
            position_flu=(-x, -y, -z),
            quaternion_target_from_flu=(1.0, 0.0, 0.0, 0.0),
            covariance=tuple(1e-4 * (k % 7 == 0) for k in range(36)),
            calibration_sd=(0.0, 0.0, 0.0),
        )
        self.feed(PoseSeen(pose))

    def _put(self, kind: type[Setpoint]) -> None:
        rng = self.rng
        fields: dict[str, Any] = {}
        if kind is StickSetpoint:
            fields = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": -2.0}
        elif kind is AttitudeSetpoint:
            fields = {"roll": 0.0, "pitch": rng.choice((0.0, 0.0, 0.05)), "yaw_rate": 0.0, "thrust": 1.0}
        elif kind is VelocitySetpoint:
            fields = {"velocity": (0.2, 0.0, 0.0), "frame": SetpointFrame.PAD}
        elif kind is PositionSetpoint:
            fields = {"position": (0.0, 0.3, 1.5), "frame": SetpointFrame.PAD}
        elif kind is TakeOffSetpoint:
            fields = {"height": 1.2}
        self.sequence += 1
        aborts = self.core._authority.aborts if self.ends_abort else 0  # noqa: SLF001
        setpoint = kind(epoch=self.epoch, sequence=self.sequence, ttl=0.3, after_abort=aborts, **fields)
        reply = self.feed(SetpointAccepted(setpoint, self.epoch))
        if reply.refusal is None or reply.refusal.token not in {"not_leased", "wrong_epoch", "not_holder"}:
            self.heard = self.now
        if reply.refusal is None:
            self.newest = setpoint.kind

    # -- what is looked at ----------------------------------------------------------------------------------------

    def _look(self, actions: list[Action]) -> None:
        for action in actions:
            match action:
                case SendSticks():
                    self._look_at_sticks(action)
                    self.toy.sent = self.now, action
                    self.number = self.number % 255 + 1
                    self.feed(FrameSent(self.number))
                    self.feed(FrameConfirmed(self.number))
                case Release():
                    self.toy.sent = None
                    self.release_ends = self.now + self.rng.choice((0.1, 0.3, 1.5))
                case PublishStatus():
                    self._look_at_status(action)
                case PublishError():
                    current = self.core._flown.current  # noqa: SLF001
                    if current is None or action.value.manoeuvre != current.kind:
                        self._breach(Breach.UNTRUE, f"error of {action.value.manoeuvre}, flown {current}")
                case _:
                    pass

    def _look_at_sticks(self, frame: SendSticks) -> None:
        limits, (pitch, roll, yaw, throttle) = self.cfg.limiter, frame.counts
        tilts = abs(pitch) <= limits.max_pitch and abs(roll) <= limits.max_roll and abs(yaw) <= limits.max_yaw
        if not tilts or not limits.min_throttle <= throttle <= limits.max_throttle:
            self._breach(Breach.LIMITS, str(frame.counts))
        key = self.core.holder_key
        if key is None or frame.epoch != key.epoch or frame.epoch != self.epoch:
            self._breach(Breach.NO_LEASE, f"epoch {frame.epoch}, the lease that was taken last has {self.epoch}")
        if frame.age > limits.setpoint_ttl and (pitch, roll, yaw) != (0, 0, 0):
            self._breach(Breach.NOT_NEUTRAL, f"{frame.age:.2f} s old: {frame.counts}")
        if self.now - self.heard > self.cfg.lease.release_after + LATEST:
            self._breach(Breach.NOT_RELEASED, f"silent for {self.now - self.heard:.2f} s")
        progress, sight = self.core._authority.progress, self.core._sight  # noqa: SLF001
        kind = "" if progress is None else progress.manoeuvre
        self.found.flown[kind] = self.found.flown.get(kind, 0.0) + PERIOD
        hover = max(sight.hover_gas if sight.estimator is None else sight.estimator.hover_gas, HOVER) - GAS_CENTRE
        is_asked = kind == "takeoff" or (kind in ("stick", "attitude") and frame.age <= limits.setpoint_ttl)
        # A landing by accident is noticed by nobody at once.
        has_stood = self.now - self.up_at > 1.0
        if has_stood and not is_asked and throttle > hover + SLACK:
            self._breach(Breach.LIFTS, f"{kind} {'' if progress is None else progress.stage}: {throttle} > {hover:.0f}")

    def _look_at_status(self, status: PublishStatus) -> None:
        current = self.core._flown.current  # noqa: SLF001
        if status.manoeuvre is not None and current is not None and status.manoeuvre != current.kind:
            self._breach(Breach.UNTRUE, f"{status.manoeuvre} is reported, {current.kind} is flown")
        if status.phase == "flying" and status.manoeuvre not in (None, self.newest):
            self._breach(Breach.UNTRUE, f"{status.manoeuvre} is flown, {self.newest} was taken last")
        if status.stage != self.stage[0]:
            self.stage = status.stage, self.now
        if not status.phase.is_in_flight or status.manoeuvre != "land":
            self.landing_began = None
        elif self.landing_began is None:
            self.landing_began = self.now
        longest = next((most for stage, most in LONGEST_STAGE.items() if stage == status.stage), math.inf)
        if status.phase.is_in_flight and self.now - self.stage[1] > longest:
            self._breach(Breach.ENDLESS, f"{status.stage} for {self.now - self.stage[1]:.1f} s")
        if self.landing_began is not None and self.now - self.landing_began > LONGEST_LANDING:
            self._breach(Breach.ENDLESS, f"a landing for {self.now - self.landing_began:.0f} s: {status.stage}")

    def _breach(self, what: Breach, seen: str) -> None:
        if len(self.found.breaches) < 5:
            self.found.breaches.append(f"{what.name} at {self.now:.2f} s: {seen}")

    # -- what happens ---------------------------------------------------------------------------------------------

    def _wait(self) -> None:
        """Nothing happens for a while."""
        for _ in range(self.rng.randrange(40)):
            self._pass()

    def _stream(self) -> None:
        kinds = (StickSetpoint, AttitudeSetpoint, VelocitySetpoint, PositionSetpoint, HoldSetpoint, TakeOffSetpoint,
                 LandSetpoint, TakeOffSetpoint, LandSetpoint)  # fmt: skip
        self.streamed = self.rng.choice(kinds)

    def _stop(self) -> None:
        self.streamed = None

    def _take(self) -> None:
        request = LeaseRequest(action="take", holder=self.rng.choice("ab"), force=self.rng.random() < 0.1)
        secret = f"{self.rng.random()}"
        reply = self.feed(LeaseAsked(request, secret))
        if reply.must_read_set:
            reply = self.feed(LeaseAsked(request, secret, SET))
        if isinstance(reply.lease, LeaseGrant):
            self.epoch, self.secret, self.sequence, self.ends_abort = reply.lease.epoch, secret, 0, False

    def _return(self) -> None:
        if self.rng.random() < 0.3 and self.epoch:
            self.feed(LeaseAsked(LeaseRequest(action="release", epoch=self.epoch, secret=self.secret), ""))

    def _release(self) -> None:
        if self.rng.random() < 0.3:
            self.feed(ReleaseAsked(ReleaseRequest(reason="fuzz")))

    def _abort(self) -> None:
        self.ends_abort = False
        self.feed(AbortAsked(AbortRequest(reason="fuzz")))

    def _resume(self) -> None:
        self.ends_abort = True

    def _die(self) -> None:
        if self.rng.random() < 0.3:
            self.feed(ClientGone(self.rng.choice("ab")))

    def _gate(self) -> None:
        self.toy.gate_is_open = self.rng.random() < 0.7

    def _gate_told(self) -> None:
        self.told["gate"] = not self.told["gate"]

    def _motors(self) -> None:
        self.toy.runs = not self.toy.stands or self.rng.random() < 0.7

    def _blind(self) -> None:
        self.told["images"] = False

    def _see(self) -> None:
        self.told["images"] = True

    def _wrong(self) -> None:
        self.wrong = (self.rng.uniform(-0.5, 0.5), 0.0, self.rng.uniform(-1.5, 1.5))
        for _ in range(self.rng.randrange(20)):
            self._pass()
        self.wrong = (0.0, 0.0, 0.0)

    def _right(self) -> None:
        self.second_camera = None

    def _camera(self) -> None:
        self.second_camera = (self.rng.choice((0.0, 0.6)), 0.0, 0.0)

    def _mute(self) -> None:
        self.told[self.rng.choice(("attitude", "flight", "battery"))] = False

    def _tell(self) -> None:
        self.told.update(attitude=True, flight=True, battery=True)

    def _battery(self) -> None:
        self.battery_is_low = self.rng.random() < 0.5

    def _model(self) -> None:
        model = AircraftModel(rad_per_count=self.rng.choice((TILT, math.radians(0.601))))
        unknown = self.rng.choice((None, ModelUnknown(Gap.UNREAD)))
        self.feed(ModelKnown(model, unknown))
        self.feed(ActiveSetRead(self.rng.choice((SET, UNREAD))))

    def _line(self) -> None:
        obstacle = self.rng.choice((None, None, *Obstacle))
        layout = None if obstacle is Obstacle.READ_ONLY else "v2"
        self.feed(LineChanged(ControlLine(layout, obstacle, "fuzz")))
        for _ in range(self.rng.randrange(10)):
            self._pass()
        self.feed(LineChanged(ControlLine("v2")))

    def _link(self) -> None:
        self._link_state(self.rng.choice((LinkCondition.UP, LinkCondition.DEGRADED, *LinkCondition)))
        for _ in range(self.rng.randrange(40)):
            self._pass()
        self.openings += self.rng.random() < 0.2
        self._link_state(LinkCondition.UP)

    def _link_state(self, condition: LinkCondition) -> None:
        fields: dict[str, Any] = {
            "condition": condition,
            "reason": "fuzz",
            "openings": self.openings,
            "firmware": "FC 2.12",
        }
        self.feed(LinkVerdict(self._made(LinkState, since=self._stamp(), **fields)))

    def _guard(self) -> None:
        if self.rng.random() < 0.2:
            self.feed(GuardActed())

    def _stand_still(self) -> None:
        self.now += self.rng.choice((0.1, 0.25, 0.4, 2.0))

    def _receiver(self) -> None:
        if self.rng.random() < 0.2:
            self.feed(StateValue(self._made(Pilot, rc_quality=0.0, has_signal=False)))
            self.now += 2.0


SET: Final = ActiveSet(Gate(GateKind.CHANNEL, 255), "Easy", emergency_throttle=110, emergency_time=90, low_cell=3.2)
"""What a FlightCtrl says that answers."""


def run_sequence(seed: int, events: int = EVENTS) -> Sequence:
    """Run one sequence; the same seed runs the same."""
    return Fuzz(seed).run(events)


def run_sequences(first: int, count: int, jobs: int) -> tuple[list[Sequence], dict[str, float]]:
    """Run many sequences, and say on stderr how far they are.

    Args:
        first: seed of the first.
        count: how many.
        jobs: processes at most.

    Returns:
        The sequences with breaches, and the seconds flown by manoeuvre in all of them.
    """
    wrong: list[Sequence] = []
    flown: Counter[str] = Counter()
    told_at = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for done, sequence in enumerate(pool.imap_unordered(run_sequence, range(first, first + count), 4), 1):
            wrong += [sequence] if sequence.breaches else []
            flown.update({kind: round(seconds, 2) for kind, seconds in sequence.flown.items()})
            if time.monotonic() - told_at > TELL_EVERY:
                told_at = time.monotonic()
                print(f"{done} of {count} sequences, {len(wrong)} with a breach", file=sys.stderr, flush=True)
    return sorted(wrong, key=lambda sequence: sequence.seed), dict(flown)
