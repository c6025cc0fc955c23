"""The vehicle's signs of life, and what the service manager is told of them."""

from __future__ import annotations

import asyncio
import socket
from types import SimpleNamespace

import pytest

from lab.rigs.waiting import running
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.vitals import status_line, vehicle_health
from mkdaemon.daemon.watchdog import Notifier, feed_watchdog
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from tests.control.events import STAMP, flight, link_state


def line(read_only=None):
    return SimpleNamespace(firmware={Board.FC: "2.12a"}, dialect=SimpleNamespace(read_only_reason=read_only))


@pytest.mark.parametrize(
    ("condition", "is_alive"), [(LinkCondition.UP, True), (LinkCondition.ONE_WAY, True), (LinkCondition.MUTE, False)]
)
def test_vehicle_alive_is_not_daemon_alive(condition, is_alive):
    facts = VehicleMemory()
    facts.link_changed(link_state(condition))
    assert vehicle_health(facts, line(), STAMP, note="").is_alive is is_alive


def test_the_status_line_says_line_motors_who_flies_and_what_is_wrong_with_the_aircraft():
    words = status_line(vehicle_health(VehicleMemory(), line(), STAMP, note=""), Phase.FREE)
    assert words == "link absent: the line has not been opened yet; motors unknown; control free"
    for error, end in ((None, "; control free"), ("no GPS", "; error: no GPS")):
        facts = VehicleMemory()
        facts.state_received(flight(is_flying=False).model_copy(update={"error": error}), STAMP.monotonic)
        assert status_line(vehicle_health(facts, line(), STAMP, note=""), Phase.FREE).endswith(end)


@pytest.fixture
def manager(tmp_path):
    """A service manager's socket and its address."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        address = str(tmp_path / "notify")
        channel.bind(address)
        channel.settimeout(60)
        yield channel, address


async def feed(notifier, progress, until, status=str):
    async with running(feed_watchdog(notifier, progress, status)):
        return await asyncio.to_thread(until)


async def test_life_is_reported_while_work_makes_progress(manager):
    channel, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "60000"})
    assert notifier.watchdog == 0.06
    steps = iter(range(10_000))
    heard = await feed(notifier, lambda: next(steps), lambda: [channel.recv(64) for _ in range(4)])
    assert heard == [b"READY=1"] + [b"WATCHDOG=1"] * 3


async def test_a_loop_that_runs_while_control_stands_still_is_not_alive(manager):
    channel, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "6000"})
    looks = 0

    def stuck() -> int:
        nonlocal looks
        looks += 1
        if looks == 20:
            notifier.send("STOPPING=1")  # marks the end for the reader below
        return 7

    def listen() -> list[bytes]:
        heard = []
        while not heard or heard[-1] != b"STOPPING=1":
            heard.append(channel.recv(64))
        return heard

    assert await feed(notifier, stuck, listen) == [b"READY=1", b"STOPPING=1"]
