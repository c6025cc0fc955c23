"""Drives a flight core by a list of events, with a clock that is a number."""

from __future__ import annotations

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import ReleaseAircraft, SendSticks
from mkdaemon.control.activeset import Gate, GateKind, KnownSet
from mkdaemon.control.core import FlightCore
from mkdaemon.control.events import (
    LeaseAsked,
    LineChanged,
    LinkVerdict,
    ReleaseAsked,
    Released,
    SetpointAccepted,
    SetpointUnsigned,
)
from mkdaemon.control.manoeuvres.table import MANOEUVRES
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import LeaseRequest, ReleaseRequest
from mkdaemon.telemetry.control import ControlLine, ReleaseOutcome
from mkdaemon.telemetry.link import LinkCondition, LinkState
from mkdaemon.telemetry.setpoint import StickSetpoint
from mkdaemon.telemetry.state import Flight, GpsMode, Pilot
from mkdaemon.telemetry.vision import VisionPose
from tests.values import made

CFG = ControlConfig()
STAMP = Stamp(monotonic=0.0, wall=0.0)
OPEN = ControlLine("v2")
CHANNEL = Gate(GateKind.CHANNEL, 250)
PERIOD = 0.02
"""Time between two setpoints of a stream [s]."""


def link_state(condition=LinkCondition.UP, reason="all is well", openings=1):
    port = {"port": "p", "baud": 57600, "hears_board": True, "board_hears_us": True}
    return made(LinkState, STAMP, condition=condition, reason=reason, openings=openings, since=STAMP, **port)


def flight(*, is_flying, motors_running=True):
    well = dict.fromkeys(("is_calibrating", "is_starting", "emergency_landing", "battery_low"), False)
    told = {"source": "nc/osd", "gps_mode": GpsMode.FREE, "motors_running": motors_running, "is_flying": is_flying}
    return made(Flight, STAMP, **told, **well)


def pilot(throttle):
    return Pilot(stamp=STAMP, source="fc/debug", rc_quality=1.0, has_signal=True, throttle=throttle, sticks=None)


def pose(at):
    """A pose of an image at a time, two metres above the target."""
    return VisionPose.model_construct(
        stamp=Stamp(monotonic=at, wall=at),
        camera="down",
        target="pad",
        source="corners",
        position_flu=(0.0, 0.0, -2.0),
        quaternion_target_from_flu=(1.0, 0.0, 0.0, 0.0),
        covariance=tuple(1e-4 * (k % 7 == 0) for k in range(36)),
    )


UP = link_state()


class Driver:
    """A flight core, its clock, and everything it wanted done."""

    def __init__(self, cfg=CFG, rows=MANOEUVRES, line=OPEN, link=UP) -> None:
        self.core = FlightCore(cfg, first_epoch=100, rows=rows)
        self.now = 0.0
        self.sequence = 0
        self.epoch = 0
        self.secret = ""
        self.leases = 0
        self.done: list[tuple[float, object]] = []
        if link is not None:
            self.core.feed(LinkVerdict(link), 0.0)
        self.core.feed(LineChanged(line), self.now)

    def of(self, kind):
        """Every action of a kind so far."""
        return [action for _, action in self.done if isinstance(action, kind)]

    def tick(self):
        """Tick now."""
        actions = self.core.tick(self.now)
        self.done += [(self.now, action) for action in actions]
        return actions

    def run(self, seconds):
        """Tick whenever the core wants to."""
        end = self.now + seconds
        while (due := max(self.core.next_time(), self.now)) <= end:
            self.now = due
            self.tick()
        self.now = end

    def request(self, action="take", *, gate=CHANNEL, **fields):
        """Ask for the lease; the gate is read as given."""
        if action in {"renew", "release"}:
            fields = {"secret": self.secret} | fields
        request = LeaseRequest(action=action, **fields)
        self.leases += 1
        secret = f"secret {self.leases}"
        reply = self.core.feed(LeaseAsked(request, secret), self.now)
        if reply.must_read_set:
            reply = self.core.feed(LeaseAsked(request, secret, KnownSet(gate)), self.now)
        if reply.refusal is not None:
            raise reply.refusal
        return reply.lease

    def take(self, holder="alice", **fields):
        """Take the lease."""
        granted = self.request(holder=holder, **fields)
        self.epoch, self.secret = granted.epoch, granted.secret
        return self.epoch

    def put(self, *, throttle=10.0, **fields):
        """One setpoint of sticks, neutral but for what is given; returns why it was refused."""
        return self.send(StickSetpoint, **{"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": throttle} | fields)

    def send(self, kind, *, epoch=None, ttl=0.3, **fields):
        """The next setpoint of a kind; returns why it was refused."""
        self.sequence += 1
        epoch = self.epoch if epoch is None else epoch
        return self.offer(kind(epoch=epoch, sequence=self.sequence, ttl=ttl, **fields))

    def offer(self, setpoint):
        """A setpoint, signed by who took the lease last; returns why it was refused."""
        key = self.core.holder_key
        is_signed = key is not None and key.secret == self.secret
        event = SetpointAccepted(setpoint, key.epoch) if is_signed else SetpointUnsigned(setpoint)
        return self.core.feed(event, self.now).refusal

    def tell(self, event):
        """Something happens now."""
        return self.core.feed(event, self.now)

    def stream(self, seconds, **setpoint):
        """Setpoints at 50 Hz."""
        for _ in range(round(seconds / PERIOD)):
            self.put(**setpoint)
            self.run(PERIOD)

    def fly(self, holder="alice"):
        """Take the lease and stream until sticks are sent; forgets what was done."""
        self.take(holder)
        self.stream(1.2)
        assert self.core.phase.value == "flying"
        self.done.clear()
        return self.epoch

    def ask_release(self, reason="asked"):
        self.core.feed(ReleaseAsked(ReleaseRequest(reason=reason)), self.now)

    def release_ends(self, outcome=ReleaseOutcome.CONFIRMED):
        self.core.feed(Released(outcome), self.now)

    @property
    def sticks(self):
        return self.of(SendSticks)

    @property
    def releases(self):
        return self.of(ReleaseAircraft)
