"""What the bus shows to a recorder."""

from __future__ import annotations

import asyncio

import msgpack
import zenoh

from mkdaemon.bus.codec import TooLong
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.intake import Arrived
from mkdaemon.bus.recording import recorded_taker
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.status import Status
from tests.bus.support import PATIENCE, ask, bus_config, client, free_endpoint, sticks_of
from tests.bus.test_gateway import BATTERY

PROOF = b"s" * 32


class Recorder:
    """Keeps what the bus shows to a recorder."""

    def __init__(self):
        self.seen = []

    def sample(self, suffix, payload, encoding, stamp):
        self.seen.append(("sample", suffix, encoding, stamp))

    def setpoint(self, suffix, payload, encoding, signature, *, at, source, is_holder):
        self.seen.append(("setpoint", suffix, payload, encoding, signature, source, is_holder))

    def setpoint_refused(self, suffix, token, reason):
        self.seen.append(("setpoint_refused", suffix, token))

    def query(self, suffix, payload, exchange, source):
        self.seen.append(("query", suffix, payload, exchange, source))

    def reply(self, suffix, payload, encoding, exchange):
        self.seen.append(("reply", suffix, msgpack.unpackb(payload)["status"], exchange))


async def test_a_recorder_is_shown_everything_that_crosses_the_bus():
    endpoint, recorder, arrived = free_endpoint(), Recorder(), asyncio.Event()

    async def answer(suffix, payload):
        return CommandResult(status=Status.ACCEPTED)

    def take(at, payload, signed_for):
        arrived.set()
        return None if signed_for == 7 else refuse(Token.NOT_HOLDER)

    async with Bus.open(bus_config(endpoint), "t8", recorder) as opened, asyncio.timeout(PATIENCE):
        opened.serve("do", answer)
        opened.receive("setpoint/stick", take, lambda payload, proof: 7 if proof == PROOF else None)
        opened.watch_client("pad", lambda name, is_here: arrived.set())
        opened.publish("state/battery", BATTERY)
        with client(endpoint) as session:
            await asyncio.to_thread(ask, session, "mk/t8/do/mark", payload=b"\x81\xa4text\xa4here")
            me, source = str(session.zid()), zenoh.SourceInfo(session.id, 1)
            for number, proof in enumerate((PROOF, b"t" * 32)):
                given = source if number == 0 else None
                session.put(sticks_of(opened), b"\x80", attachment=proof, source_info=given)
                await arrived.wait()
                arrived.clear()
            with session.liveliness().declare_token("mk/t8/client/pad"):
                await arrived.wait()
        assert opened.counts() == {"state/battery": 1}

    encoding = "application/msgpack;mk.StickSetpoint.v1"
    assert recorder.seen == [
        ("sample", "state/battery", "application/msgpack;mk.Battery.v1", BATTERY.stamp),
        ("query", "do/mark", b"\x81\xa4text\xa4here", 1, ""),
        ("reply", "do/mark", "accepted", 1),
        ("setpoint", "setpoint/stick", b"\x80", encoding, PROOF, me, True),
        ("setpoint", "setpoint/stick", b"\x80", encoding, b"t" * 32, "", False),
        ("setpoint_refused", "setpoint/stick", "not_holder"),
    ]


def test_what_is_too_long_is_taken_and_not_recorded():
    recorder, taken = Recorder(), []
    take = recorded_taker(recorder, "setpoint/stick", "", lambda at, payload, signed_for: taken.append(payload))
    take(Arrived(1.0, TooLong(9000, 1024), b"", None, None))
    assert recorder.seen == []
    assert taken == [TooLong(9000, 1024)]
