"""What the bus shows to a recorder, and reports of sources of poses at keys that only their sender can name."""

from __future__ import annotations

import asyncio
import time
from functools import partial

import msgpack
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.bus.gateway import Bus
from mkdaemon.client import connect
from mkdaemon.client.positions import PositionSender
from mkdaemon.daemon.positions import clock_of
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.signature import private_key, stamped_proof
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


SECRET = "0123456789abcdef"
SUFFIX = "positions/mocap/report"
PLAIN = f"mk/t1/{SUFFIX}"
POSE = ((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))


def receive(bus, secret):
    taken = []

    def take(at, payload, signed_for):
        taken.append((at, payload, signed_for))

    bus.receive_reports(SUFFIX, take, partial(clock_of, SUFFIX, secret), secret)
    return taken


async def test_what_the_owner_of_the_secret_sends_arrives_and_a_strangers_is_refused_by_name():
    endpoint = free_endpoint()
    async with Bus.open(bus_config(endpoint), "t1", positions={SUFFIX: SECRET}) as bus:
        taken = receive(bus, SECRET)
        bus.announce()
        async with connect("t1", endpoint) as uav:
            sender = PositionSender(uav, "mocap", SECRET, epoch=5)
            sender.send(*POSE, age=0.004)
            await wait_until(lambda: len(taken) == 1)
            (at, payload, signed_for) = taken[0]
            assert signed_for == 5
            assert 0.0 <= time.monotonic() - at < PATIENCE
            stranger = PositionSender(uav, "mocap", None, epoch=6)
            with client(endpoint) as session:
                looks = asyncio.create_task(bus.refuse_uninvited())
                await asyncio.sleep(0.02)
                while not looks.done():
                    stranger.send(*POSE)
                    await asyncio.sleep(0.01)
                await looks
                assert {signed_for for _, _, signed_for in taken[1:]} == {None}
                before = len(taken)
                forged = stamped_proof("another secret", SUFFIX, payload, 1.0)
                await asyncio.to_thread(session.put, private_key(SECRET, PLAIN), payload, attachment=forged)
                await wait_until(lambda: len(taken) == before + 1)
                assert taken[-1][2] is None


async def test_without_a_secret_the_plain_key_is_enough():
    endpoint = free_endpoint()
    async with Bus.open(bus_config(endpoint), "t1", positions={SUFFIX: None}) as bus:
        taken = receive(bus, None)
        with client(endpoint) as session:
            await asyncio.to_thread(ask, session, "mk/t1/schema/PositionReport.v1")
            await asyncio.to_thread(session.put, PLAIN, b"\x81\xa5epoch\x07")
            await wait_until(lambda: len(taken) == 1)
    assert taken[0][1:] == (b"\x81\xa5epoch\x07", 7)
