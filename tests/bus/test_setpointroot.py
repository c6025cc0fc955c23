"""Setpoints come in below a root that only holders of a lease know, and their age counts from when they were sent."""

from __future__ import annotations

import asyncio
import json
import os
import sys
import threading
import time

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import TooLate, decode_map
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.intake import LATEST, SetpointIntake
from mkdaemon.bus.senderclock import DRIFT, SenderClock
from mkdaemon.bus.setpointroot import extend_access
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.signature import SIGNATURE_BYTES, Signature, stamp_of, stamped_proof
from tests.bus.support import PATIENCE, ask, bus_config, client, free_endpoint, sticks_of

PLAIN = "mk/t1/setpoint/stick"
PROOF = bytes(SIGNATURE_BYTES)


@pytest.fixture
async def flown():
    """A bus, where it listens, and what it took: payload and epoch of the lease that signed it."""
    endpoint, taken = free_endpoint(), []
    async with Bus.open(bus_config(endpoint), "t1") as bus:
        bus.receive(
            "setpoint/stick",
            lambda at, payload, signed_for: taken.append((payload, signed_for)),
            lambda payload, proof: 7 if proof == PROOF else None,
        )
        yield bus, endpoint, taken


async def everything_arrived(session):
    """What was put goes the same way as a query."""
    await asyncio.to_thread(ask, session, "mk/t1/schema/Attitude.v1")


async def test_no_wildcard_reaches_the_holders_key_and_none_hears_it(flown):
    bus, endpoint, taken = flown
    heard = []
    secret = sticks_of(bus)
    with client(endpoint) as stranger, client(endpoint) as pilot:
        stranger.declare_subscriber(
            "**", zenoh.handlers.Callback(lambda one: heard.append(str(one.key_expr)), indirect=False)
        )
        hears = stranger.declare_publisher("mk/t1/setpoint/**")
        for pattern in ("**", "mk/**", "mk/t1/setpoint/**", "mk/t1/setpoint/*/stick", "mk/t1/setpoint/@$*/stick"):
            await asyncio.to_thread(stranger.put, pattern, b"wild", attachment=PROOF)
        await everything_arrived(stranger)
        await asyncio.to_thread(pilot.put, secret, b"mine", attachment=PROOF)
        await wait_until(lambda: PLAIN in heard)
        hears.undeclare()
    assert taken == [(b"mine", 7)]
    assert secret not in heard


async def test_what_the_holder_put_is_on_the_plain_key_as_it_came(flown):
    bus, endpoint, _ = flown
    heard: asyncio.Queue[tuple[bytes, str, bytes, str]] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def on_sample(sample):
        source = str(sample.source_info.source_id.zid)
        shown = (sample.payload.to_bytes(), str(sample.encoding), sample.attachment.to_bytes(), source)
        loop.call_soon_threadsafe(heard.put_nowait, shown)

    with client(endpoint) as watcher, client(endpoint) as pilot:
        watcher.declare_subscriber("mk/t1/setpoint/*", zenoh.handlers.Callback(on_sample, indirect=False))
        await everything_arrived(watcher)
        source = zenoh.SourceInfo(pilot.id, 1)
        await asyncio.to_thread(pilot.put, sticks_of(bus), b"forged", attachment=bytes(31), source_info=source)
        await asyncio.to_thread(pilot.put, sticks_of(bus), b"mine", attachment=PROOF, source_info=source)
        shown = await asyncio.wait_for(heard.get(), PATIENCE)
        assert shown == (b"mine", "application/msgpack;mk.StickSetpoint.v1", PROOF, str(pilot.zid()))
        assert heard.empty()


async def test_a_flood_of_the_plain_key_is_refused_where_it_is_looked_for_however_well_signed(flown):
    bus, endpoint, taken = flown
    ends = threading.Event()
    with client(endpoint) as stranger:

        def flood():
            while not ends.wait(1e-4):
                stranger.put(PLAIN, b"forged", attachment=PROOF)

        flooding = asyncio.create_task(asyncio.to_thread(flood))
        await everything_arrived(stranger)
        assert taken == [], "nobody subscribes to it"
        while not taken:
            await bus.refuse_uninvited()
        ends.set()
        await flooding
    assert set(taken) == {(b"forged", None)}
    assert len(taken) <= 8, "the newest"


STRANGER = """
import sys, zenoh
from mkdaemon.bus.session import session_config
zenoh.init_log_from_env_or("error")
mode, endpoint = sys.argv[1:]
with zenoh.open(session_config(mode, connect=[endpoint])) as session:
    session.declare_publisher("mk/t1/**")
    session.declare_subscriber("mk/t1/**", lambda sample: None)
    for _ in session.get("mk/t1/schema/Attitude.v1"):
        pass
"""


@pytest.mark.parametrize("mode", ["client", "peer"])
async def test_nobody_is_told_of_the_key_who_does_not_ask_for_it(flown, mode):
    """What Zenoh itself hears of the daemon is in its log; nothing else shows a declaration with such a chunk."""
    bus, endpoint, _ = flown
    bus.receive("setpoint/hold", lambda at, payload, signed_for: None)
    told = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", STRANGER, mode, endpoint),
        env={**os.environ, "RUST_LOG": "zenoh=debug"},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    log = (await told.communicate())[0].decode()
    assert told.returncode == 0
    assert "Register resource mk/t1/" in log  # the log shows what was declared
    assert bus.setpoint_root not in log


RULES = [
    {"id": "fly", "key_exprs": ["mk/*/do/**", "mk/*/setpoint/**"]},
    {"id": "one kind", "key_exprs": ["mk/t1/setpoint/stick"]},
    {"id": "all", "key_exprs": ["mk/**"]},
    {"id": "other vehicle", "key_exprs": ["mk/t2/setpoint/**"]},
    {"id": "see", "key_exprs": ["mk/*/sim/camera/*"]},
    {"id": "look", "key_exprs": ["mk/*/state/**"]},
]


def test_rules_that_speak_of_setpoints_or_images_speak_of_the_secret_keys():
    config = zenoh.Config()
    rest = {"permission": "allow", "flows": ["ingress"], "messages": ["put"]}
    config.insert_json5("access_control/rules", json.dumps([{**rule, **rest} for rule in RULES]))
    extend_access(config, "t1", "setpoint/@1", {"mk/t1/sim/camera/down": "mk/t1/sim/camera/down/@2"})
    rules = json.loads(config.get_json("access_control/rules"))
    setpoints, image = "mk/t1/setpoint/@1/**", "mk/t1/sim/camera/down/@2"
    assert [rule["id"] for rule in rules if setpoints in rule["key_exprs"]] == ["fly", "one kind", "all"]
    assert [rule["id"] for rule in rules if image in rule["key_exprs"]] == ["all", "see"]


@given(
    offset=st.floats(-1e6, 1e6),
    rate=st.floats(-DRIFT / 2, DRIFT / 2),
    delays=st.lists(st.floats(0.0, 5.0), min_size=1, max_size=60),
    pauses=st.lists(st.floats(0.02, 60.0), min_size=60, max_size=60),
)
def test_an_age_is_never_too_large_and_too_small_by_the_shortest_delay_at_most(offset, rate, delays, pauses):
    clock, sent_at, shortest = SenderClock(), 0.0, float("inf")
    for delay, pause in zip(delays, pauses, strict=False):
        sent_at += pause
        arrived, shortest = sent_at + delay, min(shortest + 2 * DRIFT * (pause + 5.0), delay)
        found = clock.sent(1, offset + sent_at * (1.0 + rate), arrived)
        assert arrived >= found
        assert found >= sent_at - 1e-6
        assert found - sent_at <= shortest + 2 * DRIFT * 10.0


def test_a_stamp_is_signed_with_its_payload():
    proof = stamped_proof("secret", "setpoint/stick", b"payload", 12.5)
    assert stamp_of(proof) == 12.5
    assert Signature("setpoint/stick", b"payload", proof).is_by("secret")
    forged = proof[:SIGNATURE_BYTES] + (13_000_000_000).to_bytes(8)
    assert not Signature("setpoint/stick", b"payload", forged).is_by("secret")
    moved = Signature("setpoint/stick", b"payload" + proof[SIGNATURE_BYTES:], proof[:SIGNATURE_BYTES])
    assert not moved.is_by("secret"), "the stamp is not a part of the payload"
    assert stamp_of(proof[:SIGNATURE_BYTES]) is None


async def taken_of(sends):
    """What reaches the loop of setpoints with payload and stamp, which all arrive at once."""
    taken = []
    intake = SetpointIntake(asyncio.get_running_loop(), taken.append, lambda raw, proof: 7, lambda: None)
    for payload, sent in sends:
        intake.arrived(payload, stamped_proof("", "", payload, sent))
        await asyncio.sleep(0.01)
    return taken


async def test_what_was_sent_too_long_ago_is_not_read_and_its_sender_is_told():
    now = time.monotonic() + 1000.0  # the clock of another machine
    fresh, late = await taken_of([(b"fresh", now), (b"late", now - LATEST - 0.2)])
    assert (fresh.payload, late.signed_for) == (b"fresh", 7)
    assert isinstance(late.payload, TooLate)
    with pytest.raises(CommandRejectedError, match="sent 0") as caught:
        decode_map(late.payload)
    assert caught.value.token == "setpoint_late"


async def test_the_age_of_what_waited_counts_from_when_it_was_sent():
    now = time.monotonic()
    first, second = await taken_of([(b"1", now), (b"2", now - 0.1)])
    assert second.at - second.sent == pytest.approx(0.1 + second.at - first.at, abs=0.01)


async def test_a_flood_without_stamps_is_not_flown_and_an_honest_stream_is():
    taken = []
    intake = SetpointIntake(asyncio.get_running_loop(), taken.append, lambda raw, proof: 7, lambda: None)
    for number in range(2000):
        intake.arrived(b"%d" % number, bytes(SIGNATURE_BYTES))
    await wait_until(lambda: any(isinstance(one.payload, TooLate) for one in taken))
    late = [one.payload for one in taken if isinstance(one.payload, TooLate)]
    assert late
    with pytest.raises(CommandRejectedError, match="do not say when") as caught:
        decode_map(late[-1])
    assert caught.value.token == "setpoint_late"
