"""The daemon's side of the bus, seen by a plain Zenoh client on loopback."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from contextlib import ExitStack
from functools import partial

import msgpack
import pytest
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import Payload, TooLong
from mkdaemon.bus.floods import LONGEST_MESSAGE, PLAIN_RATE, QUERY_RATES, STRANGER_RATE, ShedCounter
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.intake import FLOOD, STRANGERS, SetpointIntake
from mkdaemon.bus.session import session_config
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.state import Attitude, Battery
from mkdaemon.telemetry.status import Status
from tests.bus.support import PATIENCE, ask, bus_config, client, free_endpoint, sticks_of

STAMP = Stamp(monotonic=1.0, wall=2.0)
BATTERY = Battery(stamp=STAMP, source="nc/osd", voltage=11.4, current=2.5, used_mah=130.0, is_low=False)


@pytest.fixture
async def bus():
    endpoint = free_endpoint()
    async with Bus.open(bus_config(endpoint), "t1") as opened:
        yield opened, endpoint


@pytest.fixture
async def bus_of_one_second():
    """A bus for which no time passes: how much is too much does not depend on how fast this machine is."""
    endpoint = free_endpoint()
    async with Bus.open(bus_config(endpoint), "t1", clock=lambda: 0.0) as opened:
        yield opened, endpoint


async def test_what_the_bus_itself_subscribes_to_is_no_audience(bus):
    opened, endpoint = bus
    opened.receive("setpoint/stick", lambda stamp, raw, proof: None)
    waiting = asyncio.ensure_future(opened.wait_until_watched())
    with client(endpoint) as session:
        await asyncio.to_thread(ask, session, "mk/t1/state/*")
        assert not waiting.done()
        watcher = session.declare_subscriber("mk/t1/state/battery", zenoh.handlers.RingChannel(1))
        await asyncio.wait_for(waiting, PATIENCE)
        await asyncio.wait_for(opened.wait_until_watched(), PATIENCE)
        watcher.undeclare()


async def test_only_keys_of_the_table_can_be_published(bus):
    opened, _ = bus
    with pytest.raises(ValueError, match="state/mood"):
        opened.publish("state/mood", BATTERY)
    with pytest.raises(ValueError, match="do/lease"):
        opened.publish("do/lease", BATTERY)


async def test_schemas_can_be_asked_for(bus):
    _, endpoint = bus
    with client(endpoint) as session:
        [(_, raw, _)] = await asyncio.to_thread(ask, session, "mk/t1/schema/Attitude.v1")
        [(_, osd, _)] = await asyncio.to_thread(ask, session, "mk/t1/schema/OsdData5.v1")
        unknown = await asyncio.to_thread(ask, session, "mk/t1/schema/Nonsense.v1")
    assert json.loads(raw) == Attitude.model_json_schema()
    assert json.loads(osd)["properties"]["fields"]["properties"]["battery"]["x-unit"] == "0.1 V"
    assert unknown == []


async def test_a_command_is_answered_by_its_handler_and_refusals_keep_their_words(bus):
    opened, endpoint = bus

    async def handler(suffix: str, payload: bytes) -> CommandResult:
        if suffix == "do/release":
            return CommandResult(status=Status.ACCEPTED, reply={"heard": msgpack.unpackb(payload)})
        if suffix == "do/rates":
            raise refuse(Token.NOT_LEASED)
        raise RuntimeError("wires crossed")

    opened.serve("do", handler)
    with client(endpoint) as session:
        [(_, good, encoding)] = await asyncio.to_thread(ask, session, "mk/t1/do/release", {"a": 1})
        [(_, bad, _)] = await asyncio.to_thread(ask, session, "mk/t1/do/rates")
        [(_, broken, _)] = await asyncio.to_thread(ask, session, "mk/t1/do/lease")
        looking_around = await asyncio.to_thread(ask, session, "mk/t1/do/*")
    assert (good["status"], good["reply"]) == ("accepted", {"heard": {"a": 1}})
    assert good["duration"] >= 0
    assert encoding == "application/msgpack;mk.CommandResult.v1"
    assert (bad["status"], bad["token"]) == ("denied", "not_leased")
    assert bad["reason"]
    assert bad["fix"]
    assert (broken["status"], broken["token"]) == ("denied", "internal")
    assert looking_around == [], "a wildcard must command nothing"


async def test_leaving_ends_commands_that_still_run():
    endpoint = free_endpoint()
    begun = asyncio.Event()
    ended = asyncio.Event()

    async def handler(suffix: str, payload: bytes) -> CommandResult:
        begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            ended.set()
        raise AssertionError

    with pytest.raises(zenoh.ZError):
        zenoh.open(_impatient(endpoint))
    async with Bus.open(bus_config(endpoint), "t3") as opened:
        opened.serve("cmd", handler)
        with client(endpoint) as session:
            asking = asyncio.ensure_future(asyncio.to_thread(ask, session, "mk/t3/cmd/fc/version_request"))
            await asyncio.wait_for(begun.wait(), PATIENCE)
            await opened.stop_answering()
            assert await asyncio.wait_for(asking, PATIENCE) == []
            begun.clear()
            assert await asyncio.to_thread(ask, session, "mk/t3/cmd/fc/version_request") == []
            assert not begun.is_set(), "nothing new begins"
    assert ended.is_set()


def _impatient(endpoint):
    return session_config("client", connect=[endpoint], patience=0.05)


@pytest.fixture
async def intake():
    """Where setpoints come in, of a holder who signs "holder"; what reached the loop, and what was shed."""
    taken: list[bytes] = []
    shed = ShedCounter()
    made = SetpointIntake(
        asyncio.get_running_loop(),
        lambda arrived: taken.append(arrived.payload),
        lambda raw, proof: 7 if proof != b"stranger" else None,
        partial(shed.add, "setpoints"),
    )
    return made, taken, shed


async def test_nobody_elses_setpoints_displace_the_holders_or_flood_the_loop(intake):
    made, taken, shed = intake
    made.arrived(b"mine", b"holder")
    for number in range(5000):
        made.arrived(b"%d" % number, b"stranger")
    await asyncio.sleep(0)
    assert taken[-1] == b"mine"
    assert len(taken) == 1 + STRANGERS
    assert sum(shed.take().values()) >= 5000 - 2 * STRANGER_RATE
    assert shed.take() == {}


async def test_of_the_holders_own_flood_the_newest_comes_through(intake):
    made, taken, shed = intake
    for number in range(500):
        made.arrived(b"%d" % number, bytes(40))
    await asyncio.sleep(0)
    assert taken == [b"499"]
    made.arrived(b"next", bytes(40))
    await asyncio.sleep(0)
    assert taken == [b"499"], "the loop is given one in so long"
    await wait_until(lambda: taken == [b"499", b"next"])
    assert sum(shed.take().values()) == 500 - 1 - FLOOD


async def test_a_flood_of_commands_is_answered_busy_counted_and_shuts_out_no_release(bus_of_one_second):
    opened, endpoint = bus_of_one_second

    async def handler(suffix: str, payload: Payload) -> CommandResult:
        return CommandResult(status=Status.ACCEPTED)

    opened.serve("do", handler)
    number = int(3 * QUERY_RATES["do/lease"])
    with client(endpoint) as attacker, client(endpoint) as pilot:

        def flood() -> list[dict]:
            asked = [attacker.get("mk/t1/do/lease", timeout=PATIENCE) for _ in range(number)]
            replies = [reply.ok or reply.err for one in asked for reply in one]
            return [msgpack.unpackb(reply.payload.to_bytes()) for reply in replies]

        answers = await asyncio.to_thread(flood)
        [(_, release, _)] = await asyncio.to_thread(ask, pilot, "mk/t1/do/release")
    busy = [answer for answer in answers if answer["token"] == "busy"]
    assert release["status"] == "accepted"
    assert len(busy) >= number - QUERY_RATES["do/lease"]
    assert busy[0]["fix"]
    assert sum(opened.take_shed().values()) >= len(busy)


async def test_silent_connections_keep_no_client_out(bus):
    _, endpoint = bus
    host, _, port = endpoint.removeprefix("tcp/").partition(":")
    with ExitStack() as stack:
        for _ in range(200):  # Zenoh's own limit is 100
            stack.enter_context(socket.create_connection((host, int(port))))
        with client(endpoint) as session:
            assert await asyncio.to_thread(ask, session, "mk/t1/schema/Attitude.v1")


async def test_long_setpoints_and_requests_are_refused_by_their_length_and_cost_the_loop_nothing(bus):
    opened, endpoint = bus
    taken: list[Payload] = []
    heard: list[Payload] = []
    is_over = asyncio.Event()

    def take(stamp: float, payload: Payload, proof: bytes) -> None:
        taken.append(payload)
        if payload == b"small":
            is_over.set()

    async def handler(suffix: str, payload: Payload) -> CommandResult:
        heard.append(payload)
        return CommandResult(status=Status.ACCEPTED)

    opened.receive("setpoint/stick", take, lambda raw, proof: None)  # of the holder's the newest alone comes
    opened.serve("do", handler)
    big = msgpack.packb({str(number): number for number in range(100_000)})
    long = bytes(1000)
    with client(endpoint) as session:

        def attack() -> None:
            for payload in (*([big] * 64), long, b"small"):
                session.put(sticks_of(opened), payload, congestion_control=zenoh.CongestionControl.BLOCK)

        used = time.thread_time()
        await asyncio.to_thread(attack)
        await asyncio.wait_for(is_over.wait(), PATIENCE)
        used = time.thread_time() - used
        await asyncio.to_thread(ask, session, "mk/t1/do/lease", big)
        await asyncio.to_thread(ask, session, "mk/t1/do/waypoints_upload", bytes(5000))
    assert taken == [TooLong(len(long), 512), b"small"]
    assert heard == [TooLong(len(big), 4096), bytes(5000)]
    assert used < 0.2


@pytest.mark.parametrize("where", ["mk/t1/setpoint/stick", "mk/t1/setpoint/*", "mk/*/setpoint/stick", "mk/t1/**", "**"])
async def test_beside_a_reader_a_strangers_flood_ends_in_the_daemons_zenoh(bus, where):
    _, endpoint = bus
    heard: list[str] = []
    with client(endpoint) as reader, client(endpoint) as stranger:
        reader.declare_subscriber("mk/**", lambda sample: heard.append(str(sample.key_expr)))
        await asyncio.sleep(0.2)

        def flood() -> float:
            began = time.monotonic()
            for _ in range(2000):
                stranger.put(where, b"x")
            stranger.put("mk/t1/sim/truth", b"the end")  # a key of clients: it comes behind them on the same way
            return time.monotonic() - began

        took = await asyncio.to_thread(flood)
        await wait_until(lambda: "mk/t1/sim/truth" in heard)
    assert len(heard) - 1 <= 2 + PLAIN_RATE * (took + 1.0)


@pytest.mark.parametrize("where", ["mk/t1/state/battery", "mk/t1/tf", "mk/t1/*/battery", "mk/t1/rx/fc/version"])
async def test_what_a_stranger_puts_to_a_key_of_the_daemon_reaches_no_client(bus, where):
    opened, endpoint = bus
    heard: list[bytes] = []
    with client(endpoint) as reader, client(endpoint) as stranger:
        reader.declare_subscriber("mk/**", lambda sample: heard.append(sample.payload.to_bytes()))
        await asyncio.sleep(0.2)
        stranger.put(where, b"forged")
        stranger.delete(where)
        stranger.put("mk/t1/sim/truth", b"a client's own")
        await wait_until(lambda: b"a client's own" in heard)
        opened.publish("state/battery", BATTERY)
        await wait_until(lambda: len(heard) > 1)
    assert heard[0] == b"a client's own"
    assert msgpack.unpackb(heard[1])["voltage"] == BATTERY.voltage


async def test_the_client_that_is_watched_is_seen_coming_and_going_and_no_other(bus):
    opened, endpoint = bus
    seen: asyncio.Queue[tuple[str, bool]] = asyncio.Queue()

    def watch(name: str | None) -> None:
        opened.watch_client(name, lambda who, here: seen.put_nowait((who, here)))

    with client(endpoint) as session:
        alice, stranger = (session.liveliness().declare_token(f"mk/t1/client/{name}") for name in ("alice", "x"))
        watch("alice")
        assert await asyncio.wait_for(seen.get(), PATIENCE) == ("alice", True)
        stranger.undeclare()
        alice.undeclare()
        assert await asyncio.wait_for(seen.get(), PATIENCE) == ("alice", False)
        watch("bob")
        for _ in range(5):
            session.liveliness().declare_token("mk/t1/client/alice").undeclare()
        bob = session.liveliness().declare_token("mk/t1/client/bob")
        assert await asyncio.wait_for(seen.get(), PATIENCE) == ("bob", True)
        watch(None)
        bob.undeclare()
        await asyncio.sleep(0.2)
    assert seen.empty()


async def test_the_liveliness_token_comes_when_all_is_served_and_lives_as_long_as_the_daemon():
    endpoint = free_endpoint()

    async def tokens(session) -> list[str]:
        found = await asyncio.to_thread(lambda: list(session.liveliness().get("mk/*/alive", timeout=PATIENCE)))
        return [str(token.ok.key_expr) for token in found]

    async with Bus.open(bus_config(endpoint), "t4") as opened:
        with client(endpoint) as session:
            assert await tokens(session) == []
            opened.announce()
            async with asyncio.timeout(PATIENCE):
                while not (found := await tokens(session)):
                    pass
    assert found == ["mk/t4/alive"]


@pytest.mark.parametrize("endpoint", [None, "bogus", "tcp/127.0.0.1:99999", "tcp/nohost.invalid:1"])
async def test_an_endpoint_that_is_in_use_or_wrong_is_told_in_one_line(bus, endpoint):
    words = None if endpoint else "is in use: another mkdaemon runs here"
    with pytest.raises((ConfigError, MkError), match=words) as caught:
        async with Bus.open(bus_config(endpoint or bus[1]), "t5"):
            pass
    assert "\n" not in str(caught.value)
    assert "/root" not in str(caught.value)


@pytest.mark.parametrize("takes_images", [False, True])
async def test_messages_longer_than_any_request_are_received_for_cameras_alone(takes_images):
    endpoint, arrived = free_endpoint(), []
    async with Bus.open(bus_config(endpoint), "t1", takes_images=takes_images) as opened:
        with (
            opened.session.declare_subscriber(
                "picture", zenoh.handlers.Callback(lambda sample: arrived.append(len(sample.payload)), indirect=False)
            ),
            client(endpoint) as camera,
            client(endpoint) as other,
        ):
            camera.put("picture", bytes(2 * LONGEST_MESSAGE), congestion_control=zenoh.CongestionControl.BLOCK)
            if takes_images:
                await wait_until(lambda: 2 * LONGEST_MESSAGE in arrived)
            other.put("picture", b"small")
            await wait_until(lambda: 5 in arrived)
    assert (2 * LONGEST_MESSAGE in arrived) is takes_images


async def test_shared_memory_is_no_way_around_the_longest_message(bus):
    opened, endpoint = bus
    arrived = []
    offered = {"transport/shared_memory/enabled": True, "transport/shared_memory/mode": "init"}
    with (
        opened.session.declare_subscriber(
            "picture", zenoh.handlers.Callback(lambda sample: arrived.append(len(sample.payload)), indirect=False)
        ),
        client(endpoint, offered) as stranger,
    ):
        for size in (2 * LONGEST_MESSAGE, 2 * LONGEST_MESSAGE, 5):
            stranger.put("picture", bytes(size), congestion_control=zenoh.CongestionControl.BLOCK)
        await wait_until(lambda: 5 in arrived)
    assert arrived == [5]
