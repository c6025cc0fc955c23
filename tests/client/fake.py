"""A daemon's side of the bus without boards: grants a lease, engages, answers verbs and requests as it is told."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field

from mkdaemon.bus.codec import decode_map, schema_name
from mkdaemon.bus.gateway import Bus
from mkdaemon.client import connect
from mkdaemon.clock import Clock
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.regulator.margins import gains_of
from mkdaemon.errors import CommandRejectedError
from mkdaemon.protocol.messages import Settings
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.control import ControlStatus, LeaseGrant, LeaseState, Phase
from mkdaemon.telemetry.event import CommandEvent
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import SETPOINTS
from mkdaemon.telemetry.signature import HolderKey, Signature
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.status import Status
from tests.bus.support import bus_config, free_endpoint
from tests.values import made

VEHICLE = "fake"
EPOCH = 1000
SECRET = "known to the holder alone"
KEY = HolderKey(EPOCH, SECRET)
CLOCK = Clock()


@dataclass
class FakeDaemon:
    """What it was asked, and what it is to do.

    Attributes:
        engages: setpoints after which it says that it flies; None for never.
        asked: every command, as (suffix, fields).
        setpoints: every setpoint.
        preflight: what it answers about the checks before a flight.
        refuses: why setpoints that need a target are refused; None for not at all.
        passing: what a lease is refused with, one after the other, before it is granted.
        follow: called with every setpoint that was taken.
        replies: what makes the answer to a further command, by suffix.
        intervals: of the streams it keeps as they are asked for; None where it answers with what was asked alone.
    """

    bus: Bus
    endpoint: str
    engages: int | None = 3
    asked: list = field(default_factory=list)
    setpoints: list = field(default_factory=list)
    clients: set = field(default_factory=set)
    holder: str | None = None
    refuses: Token | None = None
    passing: list[CommandRejectedError] = field(default_factory=list)
    follow: Callable[[], None] = lambda: None
    replies: dict[str, Callable[[], dict]] = field(default_factory=dict)
    intervals: dict[str, float] | None = None
    phase: Phase = Phase.FREE
    preflight: dict = field(default_factory=lambda: {"is_ready": True, "findings": []})

    async def answer(self, suffix, payload):
        """One command."""
        fields = decode_map(payload)
        self.asked.append((suffix, fields))
        match suffix, fields.get("action"):
            case "do/lease", "take":
                if self.passing:
                    raise self.passing.pop()
                if self.holder and not fields["force"]:
                    raise refuse(Token.LEASE_HELD, holder=self.holder, left=1.0)
                self.holder = fields["holder"]
                self.say(Phase.LEASED, "waiting for a live, neutral stream")
            case "do/lease", "release":
                if (fields["epoch"], fields["secret"]) != (EPOCH, SECRET) or self.holder is None:
                    raise refuse(Token.NOT_LEASED)
                self.holder = None
                self.say(Phase.FREE, "given back")
                return CommandResult(status=Status.ACCEPTED)
            case "do/lease", _:
                pass
            case "do/release", _:
                self.lose(fields["reason"])
                reply = {"status": "confirmed", "sent": 5, "confirmed": 5, "reason": fields["reason"]}
                return CommandResult(status=Status.ACCEPTED, reply=reply)
            case "do/rates", _ if self.intervals is not None:
                if fields.get("stream"):
                    self.intervals[fields["stream"]] = fields["interval"]
                kept = {name: every for name, every in self.intervals.items() if every}
                return CommandResult(status=Status.ACCEPTED, reply={"intervals": kept})
            case "do/rates", _:
                return CommandResult(status=Status.ACCEPTED, reply={"intervals": {"osd": fields.get("interval", 0.1)}})
            case "do/gains", _:
                return CommandResult(status=Status.ACCEPTED, reply=dict(gains_of(AircraftModel(), ControlConfig())))
            case "do/preflight", _:
                return CommandResult(status=Status.ACCEPTED, reply=self.preflight)
            case "do/labels", _:
                return CommandResult(status=Status.ACCEPTED, reply={"board": fields["board"], "names": ["one", "two"]})
            case "cmd/fc/settings_request", _:
                message = Settings(index=3, parameters=bytes(range(100)))
                return CommandResult(status=Status.ACCEPTED, reply=dict(message), reply_type=schema_name(Settings))
            case "cmd/fc/version_request", _:
                raise refuse(Token.TIMEOUT, board="fc", name="version_request", detail="3 tries")
            case "cmd/fc/motor_test", _:
                return CommandResult(status=Status.NOT_OBSERVABLE)
            case _ if suffix in self.replies:
                return CommandResult(status=Status.ACCEPTED, reply=self.replies[suffix]())
            case _:
                raise refuse(Token.UNKNOWN_VERB, name=suffix, near="lease")
        shown = self.lease()
        if shown is not None and fields.get("action") == "take":
            shown = LeaseGrant(**dict(shown), secret=SECRET, setpoint_root=self.bus.setpoint_root)
        return CommandResult(status=Status.ACCEPTED, reply=None if shown is None else dict(shown))

    def lease(self):
        """The lease as the bus shows it."""
        return LeaseState(holder=self.holder, epoch=EPOCH, ttl=5.0, left=5.0) if self.holder else None

    def say(self, phase, reason, lease=None, **progress):
        """Publish `control/status`."""
        self.phase = phase
        known = {"phase": phase, "reason": reason, "lease": lease or self.lease(), "external_control": "V3"}
        self.bus.publish("control/status", made(ControlStatus, CLOCK.stamp(), **known, **progress))

    def lose(self, reason, **progress):
        """Let go of the aircraft."""
        self.holder = None
        self.say(Phase.RELEASING, reason, **progress)

    def take_setpoint(self, arrived, raw, signed_for):
        """One setpoint."""
        assert signed_for == EPOCH
        self.setpoints.append(decode_map(raw))
        if self.refuses is not None:
            self.refuse_setpoint(self.setpoints[-1])
            return
        if self.holder and self.phase is Phase.LEASED and self.engages and len(self.setpoints) >= self.engages:
            self.say(Phase.FLYING, f"{self.holder} flies")
        self.follow()

    def refuse_setpoint(self, fields):
        """Publish that a position setpoint was refused."""
        error = refuse(self.refuses, name="setpoint/position", frame="home")
        words = {"token": error.token, "reason": error.reason, "fix": error.fix}
        event = made(CommandEvent, CLOCK.stamp(), key="setpoint/position", fields=fields, status="denied", **words)
        self.bus.publish("event/command", event)

    def client_changed(self, name, is_here):
        """A client came or went."""
        (self.clients.add if is_here else self.clients.discard)(name)

    def publish_attitude(self, yaw):
        """Publish `state/attitude`."""
        self.bus.publish("state/attitude", made(Attitude, CLOCK.stamp(), yaw=yaw))


@asynccontextmanager
async def fake_daemon(**more):
    """A fake daemon on a bus of its own."""
    endpoint = free_endpoint()
    async with Bus.open(bus_config(endpoint), VEHICLE) as bus:
        daemon = FakeDaemon(bus, endpoint, **more)
        for root in ("do", "cmd"):
            bus.serve(root, daemon.answer)
        for kind in SETPOINTS:
            bus.receive(
                kind.suffix,
                daemon.take_setpoint,
                lambda raw, proof, kind=kind: KEY.epoch_signed(Signature(kind.suffix, raw, proof)),
            )
        bus.watch_client("*", daemon.client_changed)
        bus.announce()
        yield daemon


@contextmanager
def in_background(serving):
    """Keep an asynchronous context open in a thread, for a command that wants the main one; yields what it yields."""
    ready, found = threading.Event(), []

    async def live():
        loop, stop = asyncio.get_running_loop(), asyncio.Event()
        async with serving as served:
            found.extend([served, lambda: loop.call_soon_threadsafe(stop.set)])
            ready.set()
            await stop.wait()

    def run():
        try:
            asyncio.run(live())
        finally:
            ready.set()

    thread = threading.Thread(target=run)
    thread.start()
    ready.wait()
    try:
        yield found[0]
    finally:
        found[1]()
        thread.join()


@asynccontextmanager
async def connected(**more):
    """A fake daemon and a client of it."""
    async with fake_daemon(**more) as daemon, connect(VEHICLE, daemon.endpoint) as uav:
        yield daemon, uav


async def settle(uav):
    """Return when the daemon knows what the client subscribed to: its messages arrive in order."""
    await uav.rates()
