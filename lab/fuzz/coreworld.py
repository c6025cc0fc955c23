"""What surrounds the flight core in `python -m lab fuzz --core`: a toy aircraft, its boards, cameras, client and pilot.

A sequence is a list of happenings, each with a number of its own, so a shorter list replays the rest unchanged. After
each happening the world goes on for a pause: the toy moves, boards and cameras report, the client streams.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from lab.fuzz.coretoy import STAND, SWUNG, TILT, Swing, Toy, swung
from mkdaemon.config.control import ControlConfig
from mkdaemon.control import events
from mkdaemon.control.actions import Action, ReleaseAircraft, SendSticks
from mkdaemon.control.activeset import UNREAD, Gate, GateKind, KnownSet
from mkdaemon.control.core import FlightCore
from mkdaemon.control.estimator.model import AircraftModel, Gap, ModelUnknown
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import AbortRequest, LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, LeaseGrant, Obstacle, ReleaseOutcome
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkState, RoundTripStats
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.telemetry.setpoint import (
    SETPOINTS,
    AttitudeSetpoint,
    LandSetpoint,
    PathSetpoint,
    PositionSetpoint,
    Setpoint,
    SetpointFrame,
    StickSetpoint,
    TakeOffSetpoint,
    VelocitySetpoint,
)
from mkdaemon.telemetry.state import Attitude, Battery, Flight, GpsMode, Pilot
from mkdaemon.telemetry.vision import Alarm, EyeState, PoseRefusal, PoseRefused, VisionPose, VisionStats

LONGEST_STEP: Final = 0.1
"""The toy moves, and the core ticks, at least this often [s]."""
NEVER: Final = 10**9
"""Steps between two attitudes of boards that report none."""
STRAIGHT: Final = (0.0, 0.0, 0.0)
"""An image without an error [m]."""
CARRIED_STEP: Final = 0.05
"""An aircraft that is carried reports, and is seen, this often [s]."""
LATENCY: Final = 0.06
"""From an exposure to its pose [s]."""
PADS: Final = {"pad": (0.0, 0.0), "mat": (1.5, 0.0)}
"""Targets, and where they lie [m]."""
GOOD_SET: Final = KnownSet(Gate(GateKind.CHANNEL, 255), "Easy", emergency_throttle=110, emergency_time=90, low_cell=3.2)
"""An active set that allows everything."""


class Happening(NamedTuple):
    """One random event: what happens, the number that its details are drawn from, and the pause after it [s]."""

    what: str
    number: int
    pause: float


@dataclass
class Trouble:
    """What is wrong with boards and cameras.

    Attributes:
        muted: kinds of state values, or images, that do not come.
        flight: fields of `Flight` that are not as they should be.
        pilot: fields of `Pilot` likewise.
        voltage: of the battery [V].
        tipped: tilt that the boards report of an aircraft that stands [rad].
        images_every: steps between two images; 0 for as many as usual.
        error: of every image of the first camera [m], until a time [s].
        second: camera, target and error of another stream of images [m].
        eye: fields of `VisionStats` that are not as they should be.
        shows_gate: the boards say where the gate stands.
        carried: how the aircraft is swung by hand; None while it is not.
    """

    muted: set[str] = field(default_factory=set)
    flight: dict[str, Any] = field(default_factory=dict)
    pilot: dict[str, Any] = field(default_factory=dict)
    voltage: float = 16.0
    tipped: float = 0.0
    images_every: int = 0
    error: tuple[tuple[float, float, float], float] = (STRAIGHT, 0.0)
    second: tuple[str, str, float] | None = None
    eye: dict[str, Any] = field(default_factory=dict)
    shows_gate: bool = False
    carried: Swing | None = None


class World:
    """Everything around one flight core.

    Attributes:
        core: that is fuzzed.
        toy: the aircraft.
        now: [s].
        trouble: at present.
        epoch: of the client's newest lease; 0 before the first.
        newest: the newest setpoint that the core has taken; None before the first of a lease.
        heard: when the holder of the lease last put a setpoint [s].
        must_release: the next tick has to release.
        is_sure: the client wants nothing else, whatever is refused.
        is_aborted: an abort was accepted, and no setpoint has ended it.
        releasing_until: when the release that is under way ends [s]; infinite while none is.
        reached: what has been reached, counted.
    """

    def __init__(self, rng: random.Random, cfg: ControlConfig) -> None:
        self.cfg, self.reached = cfg, Counter[str]()
        self.core = FlightCore(cfg, first_epoch=1000)
        self.toy = Toy(rng.choice((STAND, STAND, 1.0, 2.0)))
        self.trouble = Trouble()
        self.now, self.steps, self.openings, self.number = 0.0, 0, 1, 0
        self.epoch, self.sequence, self.aborts = 0, 0, 0
        self.secret = ""
        self.newest: Setpoint | None = None
        self.heard, self.releasing_until = -math.inf, math.inf
        self.must_release = self.is_aborted = self.is_resuming = False
        self.wanted: type[Setpoint] = StickSetpoint
        self.asks: dict[str, Any] = STILL
        self.is_silent = self.is_sure = False
        self.says_flying = rng.random() < 0.5
        self.images_every, self.attitude_every = rng.choice((1, 2, 2, 3)), rng.choice((*(2, 3) * 15, NEVER))
        self.heal(rng)

    def feed(self, event: events.Event) -> events.Reply:
        """Tell the core."""
        self.reached[f"event {type(event).__name__}"] += 1
        reply = self.core.feed(event, self.now)
        if reply.refusal is not None:
            self.reached[f"refusal {reply.refusal.token}"] += 1
        return reply

    @property
    def longest_step(self) -> float:
        """The toy moves, and the core ticks, at least this often [s]."""
        return LONGEST_STEP if self.swing is None else CARRIED_STEP

    @property
    def swing(self) -> Swing | None:
        """How the aircraft is swung by hand; None while it is not: nobody carries one that flies."""
        carried = self.trouble.carried
        if carried is None or self.now - carried.since > SWUNG + 1.0 or self.core.phase.is_in_flight:
            return None
        return carried

    def go_on(self, rng: random.Random, dt: float) -> None:
        """Move the toy on; boards and cameras report, the client streams."""
        self.now += dt
        self.steps += 1
        self.toy.step(self.now, dt)
        self._report()
        if self.now >= self.releasing_until:
            self.releasing_until = math.inf
            self.feed(events.Released(rng.choice((*ReleaseOutcome, None))))
        self._stream(rng)

    # -- boards and cameras ---------------------------------------------------------------------------------------

    def made(self, kind: type[Any], **fields: Any) -> Any:
        """A value of this moment with everything else unknown."""
        unknown = dict.fromkeys(kind.model_fields)
        return kind.model_construct(**{**unknown, "stamp": self.stamp(), "source": "nc/osd", **fields})

    def stamp(self, age: float = 0.0) -> Stamp:
        """A moment before now [s]."""
        return Stamp.model_construct(monotonic=self.now - age, wall=self.now - age)

    def _report(self) -> None:
        toy, trouble, steps, muted = self.toy, self.trouble, self.steps, self.trouble.muted
        if (self.swing or steps % self.attitude_every == 0) and "attitude" not in muted:
            pitch, roll = trouble.tipped if toy.stands else toy.tilt[0], -toy.tilt[1]
            pitch += 0.0 if self.swing is None else swung(self.now)
            level = (1.0, 0.0, 0.0, 0.0)
            self.feed(events.StateValue(self.made(Attitude, quaternion=level, roll=roll, pitch=pitch, yaw=0.0)))
        if steps % 4 == 0 and "flight" not in muted:
            self.feed(events.MotorsReported(toy.runs))
            flies = not toy.stands if self.says_flying else toy.runs
            fields = {"motors_running": toy.runs, "is_flying": flies, "gps_mode": GpsMode.FREE, **trouble.flight}
            self.feed(events.StateValue(self.made(Flight, **fields)))
        if steps % 4 == 1 and "pilot" not in muted:
            gate = toy.gate_is_open if trouble.shows_gate else None
            fields = {"rc_quality": 1.0, "has_signal": True, "throttle": toy.lid, "is_gate_open": gate, **trouble.pilot}
            self.feed(events.StateValue(self.made(Pilot, **fields)))
        if steps % 8 == 2 and "battery" not in muted:
            is_low = trouble.voltage < 13.0
            self.feed(events.StateValue(self.made(Battery, voltage=trouble.voltage, is_low=is_low)))
        if steps % 8 == 3:
            self._report_eye()
        is_shown = self.swing or steps % (trouble.images_every or self.images_every) == 0
        if is_shown and "images" not in muted:
            error, until = trouble.error
            self._show("down", "pad", error if self.now <= until else STRAIGHT)
            if trouble.second is not None:
                camera, target, aside = trouble.second
                self._show(camera, target, (aside, 0.0, 0.0))

    def _report_eye(self) -> None:
        fields = {"camera": "down", "state": EyeState.OK, "reason": "", "alarms": {}, "processed": 9, "selfcal": ()}
        self.feed(events.EyeStats(self.made(VisionStats, **{**fields, "latency_p50_ms": 60.0, **self.trouble.eye})))

    def _show(self, camera: str, target: str, error: tuple[float, float, float]) -> None:
        x, y = PADS[target]
        place = [at - LATENCY * speed for at, speed in zip(self.toy.place, self.toy.velocity, strict=True)]
        seen = (x - place[0] - error[0], y - place[1] - error[1], -place[2] - error[2])
        pitch = 0.0 if self.swing is None else self.swing.seen(self.now - LATENCY)
        c, s = math.cos(pitch), math.sin(pitch)
        seen = (c * seen[0] - s * seen[2], seen[1], s * seen[0] + c * seen[2])
        if math.hypot(seen[0], seen[1]) > -1.3 * seen[2] or seen[2] > -0.02:
            return
        pose = self.made(
            VisionPose,
            stamp=self.stamp(LATENCY),
            camera=camera,
            target=target,
            position_flu=seen,
            quaternion_target_from_flu=(math.cos(pitch / 2.0), 0.0, math.sin(pitch / 2.0), 0.0),
            covariance=COVARIANCE,
            calibration_sd=(0.0, 0.0, 0.0),
        )
        self.feed(events.PoseSeen(pose))

    def carry_out(self, actions: list[Action], rng: random.Random) -> None:
        """Do what the core has decided: frames reach the toy and are confirmed, a release takes its time."""
        for action in actions:
            if isinstance(action, SendSticks):
                self.toy.sent = self.now, action
                self.number = self.number % 255 + 1
                self.feed(events.FrameSent(self.number))
                self.feed(events.FrameConfirmed(self.number))
            elif isinstance(action, ReleaseAircraft):
                self.toy.sent, self.releasing_until = None, self.now + rng.choice((0.05, 0.2, 0.2, 1.5))

    # -- the client -----------------------------------------------------------------------------------------------

    @property
    def is_held(self) -> bool:
        """Whether the client holds the lease."""
        key = self.core.holder_key
        return key is not None and key.epoch == self.epoch

    def _stream(self, rng: random.Random) -> None:
        if not self.is_held:
            if rng.random() < 0.3:
                self.take(rng)
        elif not self.is_silent and (self.swing is None or self.swing.is_over(self.now)):
            is_taken = self.put(self.setpoint(self.wanted, **self.asks))
            if not self.is_sure and rng.random() < (0.1 if not is_taken or not self.core.phase.is_in_flight else 0.0):
                self.wish(rng)

    def setpoint(self, kind: type[Setpoint], **fields: Any) -> Setpoint:
        """The next setpoint of the stream."""
        self.sequence += 1
        aborts = self.aborts if self.is_resuming else 0
        common = {"epoch": self.epoch, "sequence": self.sequence, "ttl": 0.3, "after_abort": aborts}
        return kind(**{**common, **fields})

    def put(self, setpoint: Setpoint, signed_for: int | None = None) -> bool:
        """Stream a setpoint that is signed for a lease, the newest one if none is given; whether the core takes it."""
        reply = self.feed(events.SetpointAccepted(setpoint, self.epoch if signed_for is None else signed_for))
        if reply.refusal is None:
            self.newest = setpoint
        if reply.refusal is None or reply.refusal.token not in STRANGERS:
            self.heard = self.now
            self.is_aborted = self.is_aborted and not 0 < setpoint.after_abort == self.aborts
        return reply.refusal is None

    def take(self, rng: random.Random, *, force: bool = False) -> None:
        """Ask for the lease."""
        has_set, secret = rng.random() < 0.9, f"{rng.random()}"
        request = LeaseRequest(action="take", holder=rng.choice("ab"), force=force)
        was_held = self.core.holder_key is not None
        reply = self.feed(events.LeaseAsked(request, secret))
        if reply.must_read_set:
            found = GOOD_SET if has_set else rng.choice(BAD_SETS)
            reply = self.feed(events.LeaseAsked(request, secret, found))
        if isinstance(reply.lease, LeaseGrant):
            self.must_release = self.must_release or was_held
            self.epoch, self.secret, self.sequence = reply.lease.epoch, secret, 0
            self.newest, self.heard, self.is_aborted, self.is_resuming = None, self.now, False, False
            if not self.is_sure:
                self.wish(rng)

    def wish(self, rng: random.Random) -> None:
        """Stream another kind of setpoint from now on."""
        self.is_sure = False
        likely = (TakeOffSetpoint,) * 12 if self.toy.stands else (LandSetpoint, PositionSetpoint) * 2
        kind = self.wanted = rng.choice((*SETPOINTS, *likely))
        frame = SetpointFrame.HOME if rng.random() < 0.03 else SetpointFrame.PAD
        fields: dict[type[Setpoint], dict[str, Any]] = {
            StickSetpoint: STILL,
            AttitudeSetpoint: {"roll": 0.0, "pitch": 0.0, "yaw_rate": 0.0, "thrust": 1.0},
            VelocitySetpoint: {"velocity": (rng.uniform(-0.3, 0.3), 0.0, 0.0), "frame": frame},
            PositionSetpoint: {"position": (rng.uniform(-0.5, 0.5), 0.3, rng.uniform(0.5, 2.0)), "frame": frame},
            TakeOffSetpoint: {"height": rng.uniform(0.5, 1.5)},
        }
        if kind is PathSetpoint:
            fields[kind] = {"path": self.upload(rng), "run": self.sequence, "paused": rng.random() < 0.2}
        self.asks = fields.get(kind, {})
        if "target" in kind.model_fields and rng.random() < 0.15:
            self.asks = {**self.asks, "target": rng.choice(tuple(PADS))}

    def upload(self, rng: random.Random) -> str:
        """Upload a short path; its id, or that of none where it leaves the fence or is forgotten."""
        far = rng.choice((0.2, 0.3, 20.0))
        points = tuple(PathPoint(position=(x, 0.0, 1.0), time=time) for x, time in ((0.0, None), (far, 2.0)))
        refusal = self.feed(events.PathUploaded(PathUploadRequest(points=points))).refusal
        stored = self.core.path_stored
        return "none" if refusal is not None or stored is None or rng.random() < 0.05 else stored.id

    # -- what happens ---------------------------------------------------------------------------------------------

    def heal(self, rng: random.Random) -> None:
        """Everything is well again."""
        self.trouble, self.toy.gate_is_open, self.toy.lid = Trouble(), True, 80.0
        self.toy.runs = True
        self.is_silent = False
        self.link(LinkCondition.UP)
        health = self.made(LinkHealth, echo=RoundTripStats(sent=10), confirm=RoundTripStats(p50_ms=30.0))
        for event in (
            *(
                events.GuardChanged(is_alive=True),
                events.FlightctrlReported(is_lost=False),
                events.FreeDisk(1e10),
                events.CellsKnown(4),
            ),
            *(
                events.LineChanged(ControlLine("v2")),
                events.LinkMeasured(health),
                events.ModelKnown(AircraftModel(rad_per_count=TILT)),
            ),
            events.ActiveSetRead(GOOD_SET),
        ):
            self.feed(event)

    def link(self, condition: LinkCondition) -> None:
        """The line is judged."""
        state = self.made(LinkState, condition=condition, reason="fuzz", openings=self.openings, firmware="FC 2.12")
        self.feed(events.LinkVerdict(state))


def _calm(world: World, rng: random.Random) -> None:
    """Nothing special."""


def settle(world: World, rng: random.Random) -> None:
    """Nothing else happens for long: the client lands, perhaps by rare images, or takes off."""
    world.is_silent, world.is_sure = False, True
    if world.toy.stands:
        world.wanted, world.asks = TakeOffSetpoint, {"height": 0.5}
    else:
        world.wanted, world.asks = LandSetpoint, {}
        world.trouble.images_every = rng.choice((1, 1, 3, 5, 8, 10))


def carry(world: World, rng: random.Random) -> None:
    """The aircraft is swung by hand over the target for seconds, before a flight; its camera may be wrong."""
    world.heal(rng)
    world.is_sure, world.wanted = True, PositionSetpoint
    world.asks = {"position": (0.0, 0.0, 1.0), "frame": SetpointFrame.PAD}
    world.trouble.carried = Swing(world.now, *rng.choice(((-1.0, 0.0), (1.0, 0.15), (1.0, 0.0))))


def _lean(world: World, rng: random.Random) -> None:
    if world.wanted is StickSetpoint:
        world.asks = {**world.asks, "pitch": rng.uniform(-20.0, 20.0), "throttle": rng.uniform(-20.0, 20.0)}
    elif world.wanted is AttitudeSetpoint:
        world.asks = {**world.asks, "pitch": rng.uniform(-0.1, 0.1), "thrust": rng.uniform(0.8, 1.2)}


def _silence(world: World, rng: random.Random) -> None:
    world.is_silent = True


def _abort(world: World, rng: random.Random) -> None:
    world.is_resuming = False
    if world.feed(events.AbortAsked(AbortRequest(reason="fuzz"))).refusal is None:
        world.aborts, world.is_aborted = world.aborts + 1, True


def _resume(world: World, rng: random.Random) -> None:
    world.is_resuming = True


def _release(world: World, rng: random.Random) -> None:
    world.feed(events.ReleaseAsked(ReleaseRequest(reason="fuzz")))
    world.must_release = True


def _give_back(world: World, rng: random.Random) -> None:
    request = LeaseRequest(action="release", epoch=world.epoch, secret=rng.choice((world.secret, world.secret, "no")))
    is_given = world.feed(events.LeaseAsked(request, "")).refusal is None
    world.must_release = world.must_release or is_given


def _renew(world: World, rng: random.Random) -> None:
    request = LeaseRequest(action=rng.choice(("renew", "show")), epoch=world.epoch, secret=world.secret)
    world.feed(events.LeaseAsked(request, ""))


def _client_dies(world: World, rng: random.Random) -> None:
    before = world.core.holder_key
    world.feed(events.ClientGone(rng.choice("ab")))
    world.must_release = world.must_release or (before is not None and world.core.holder_key is None)


def _other_client(world: World, rng: random.Random) -> None:
    world.take(rng, force=rng.random() < 0.5)


def _bad_setpoint(world: World, rng: random.Random) -> None:
    bad = {"epoch": max(0, world.epoch + rng.choice((-1, 1)))}, {"sequence": 0}, {"sequence": world.sequence + 99_999}
    setpoint = world.setpoint(world.wanted, **{**world.asks, **rng.choice(bad)})
    match rng.randrange(3):
        case 0:
            world.feed(events.SetpointUnsigned(setpoint))
        case 1:
            error = refuse(Token.MALFORMED, detail="fuzz")
            world.feed(events.SetpointUnreadable(setpoint.suffix, {}, error, is_by_holder=rng.random() < 0.5))
        case _:
            world.put(setpoint, rng.choice((world.epoch, 0)))


def _gate(world: World, rng: random.Random) -> None:
    world.toy.gate_is_open, world.trouble.shows_gate = rng.random() < 0.3, rng.random() < 0.5


def _motors(world: World, rng: random.Random) -> None:
    world.toy.runs = not world.toy.stands and rng.random() < 0.7


def _lid(world: World, rng: random.Random) -> None:
    world.toy.lid = rng.uniform(-127.0, 20.0)
    world.trouble.pilot["throttle_in_use"] = world.toy.lid


def _trouble(world: World, rng: random.Random) -> None:
    """Boards or cameras go wrong until everything is well again; see `Trouble`."""
    error = rng.uniform(-0.5, 0.5), 0.0, rng.choice((rng.uniform(-1.5, 1.5), 0.0))
    heights: dict[str, Any] = {
        "height_covered": 1.0,
        "height_odds": 9.0,
        "height_percent": 30.0,
        "height_sd_percent": 2.0,
    }
    flags = ("altitude_control", "emergency_landing", "battery_low")
    eyes: tuple[dict[str, Any], ...] = (
        {"state": rng.choice(tuple(EyeState)), "reason": "fuzz"},
        {"alarms": {rng.choice(tuple(Alarm)): "fuzz"}},
        {"latency_p50_ms": 900.0},
        {"selfcal": (SelfCalibration.model_construct(target="pad", **heights),)},
    )
    kinds: tuple[tuple[str, Any], ...] = (
        *[("muted", {rng.choice(("images", "images", "images", "attitude", "flight", "battery", "pilot"))})] * 5,
        *[("error", (error, world.now + rng.uniform(0.0, rng.choice((0.25, 0.25, 1.5)))))] * 3,
        *[("second", rng.choice((("forward", "pad", 0.0), ("forward", "pad", 0.6), ("down", "mat", 0.0))))] * 2,
        *[("eye", each) for each in eyes],
        ("images_every", 5),
        ("tipped", 0.3),
        ("voltage", rng.choice((12.0, 12.0, 13.5, 20.0))),
        ("flight", rng.choice(({rng.choice(flags): True}, {"gps_mode": rng.choice(tuple(GpsMode))}))),
        ("pilot", {"rc_quality": rng.choice((0.0, 0.6)), "has_signal": rng.random() < 0.5}),
    )
    setattr(world.trouble, *rng.choice(kinds))


def _report(world: World, rng: random.Random) -> None:
    """Something is reported that lasts until everything is well again."""
    obstacle, gap = rng.choice(tuple(Obstacle)), rng.choice((None, *Gap))
    line = ControlLine(None if obstacle is Obstacle.READ_ONLY else "v2", obstacle, "fuzz")
    unknown = None if gap is None else ModelUnknown(gap, "Gyro_P", 0, 1)
    echo = RoundTripStats(sent=10, lost=6, loss_percent=60.0, p50_ms=rng.choice((None, 150.0)))
    reports: tuple[events.Event, ...] = (
        *[events.LineChanged(line)] * 3,
        *[events.ModelKnown(AircraftModel(rad_per_count=rng.choice((TILT, 1.33 * TILT))), unknown)] * 2,
        *[events.LinkMeasured(world.made(LinkHealth, echo=echo, confirm=RoundTripStats()))] * 2,
        *[events.ActiveSetRead(rng.choice((GOOD_SET, *BAD_SETS)))] * 2,
        *(
            events.GuardChanged(is_alive=False),
            events.FreeDisk(rng.choice((None, 1e6))),
            events.FlightctrlReported(is_lost=True),
        ),
        *(events.MotorTestSent(), events.ListChanged(), events.CellsKnown(rng.choice((3, 4, 6)))),
        events.FrameNotSent(refuse(Token.LINK_DOWN, state="down", detail="fuzz")),
    )
    world.feed(rng.choice(reports))


def _unusable_image(world: World, rng: random.Random) -> None:
    fields = {"camera": "down", "target": "pad", "has_attitude": True, "decode_age": rng.choice((None, 0.0))}
    world.feed(events.SightRefused(world.made(PoseRefused, refusal=rng.choice(tuple(PoseRefusal)), **fields)))
    world.trouble.muted = {"images"}


def _link(world: World, rng: random.Random) -> None:
    world.openings += rng.random() < 0.2
    world.link(rng.choice(tuple(LinkCondition)))


def _guard(world: World, rng: random.Random) -> None:
    world.feed(events.GuardActed())
    world.must_release = True


def _stand_still(world: World, rng: random.Random) -> None:
    """The daemon stands still: no tick, no report."""
    world.now += rng.choice((0.1, 0.25, 0.4, 2.0))


STILL: Final = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": -2.0}
"""What a client's sticks begin with."""
COVARIANCE: Final = tuple(1e-4 * (k % 7 == 0) for k in range(36))
"""Of a pose."""
STRANGERS: Final = frozenset({Token.NOT_LEASED, Token.WRONG_EPOCH, Token.NOT_HOLDER, Token.STALE_SEQUENCE,
                              Token.SEQUENCE_JUMP})  # fmt: skip
"""Refusals of setpoints that are no sign of life of the holder."""
BAD_SETS: Final = (
    UNREAD,
    KnownSet(Gate(GateKind.CONSTANT, 100), "shut"),
    KnownSet(Gate(GateKind.CONSTANT, 255), "constant"),
    KnownSet(Gate(GateKind.CHANNEL, 255, altitude_channel=6), "both"),
    KnownSet(Gate(GateKind.CHANNEL, 255), "height", has_height_control=True),
    KnownSet(Gate(GateKind.CHANNEL, 255), "climbs", emergency_throttle=130, emergency_time=90),
)
"""Active sets with something in the way."""
HAPPENINGS: Final[dict[Callable[[World, random.Random], None], float]] = {
    _calm: 60.0, World.wish: 3.0, World.heal: 12.0, settle: 0.1, carry: 0.05, _lean: 4.0, _silence: 1.0, _abort: 1.5,
    _resume: 1.5, _release: 0.4, _give_back: 0.4, _renew: 0.5, _client_dies: 0.4, _other_client: 0.7,
    _bad_setpoint: 2.0, _gate: 1.5, _motors: 1.0, _lid: 0.6, _trouble: 10.0, _unusable_image: 0.8, _report: 4.0,
    _link: 1.0, _guard: 0.2, _stand_still: 0.3,
}  # fmt: skip
"""What can happen, and how often it does, relative to the others."""
