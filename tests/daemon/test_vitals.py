"""The vehicle's signs of life, and what the service manager is told of them."""

from __future__ import annotations

import asyncio
import socket
from io import StringIO
from types import SimpleNamespace

import pytest
from rich.console import Console

from lab.rigs.waiting import running
from mkdaemon.cli.mkctl.status import render
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.vitals import status_line, vehicle_health
from mkdaemon.daemon.watchdog import Notifier, feed_watchdog
from mkdaemon.protocol.wire import Board
from mkdaemon.reading import Reading
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.record import RecordStatus
from tests.control.events import STAMP, flight, link_state


def line(read_only=None):
    return SimpleNamespace(firmware={Board.FC: "2.12a"}, dialect=SimpleNamespace(read_only_reason=read_only))


def picture_of(key, value):
    reading = Reading()
    reading.take(key, value, 0.0)
    return reading.at(0.0)


def test_before_the_line_was_opened_the_vehicle_is_not_alive():
    health = vehicle_health(VehicleMemory(), line("unknown firmware"), STAMP, note="a note")
    assert (health.is_alive, health.link, health.read_only) == (False, "absent", "unknown firmware")
    assert (health.motors_running, health.error, health.note) == (None, None, "a note")
    assert health.firmware == {"fc": "2.12a"}


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


def test_an_open_bus_is_told_to_everybody():
    health = vehicle_health(VehicleMemory(), line(), STAMP, note="", open_endpoints=("tcp/0.0.0.0:7447",))
    assert health.open_endpoints == ("tcp/0.0.0.0:7447",)
    with StringIO() as screen:
        Console(file=screen, width=120).print(render("mk1", picture_of("health", health)))
        assert "OPEN: any client in the network may fly, at tcp/0.0.0.0:7447" in screen.getvalue()


@pytest.mark.parametrize(
    ("state", "reason", "lost", "words"),
    [
        ("recording", "", 0, "12 entries, 3 MB"),
        ("recording", "", 7, "12 entries, 3 MB, 7 LOST"),
        ("full", "the disk has none", 7, "NOT RECORDING, no room: the disk has none, 7 LOST"),
    ],
)
def test_the_screen_says_whether_everything_is_recorded(state, reason, lost, words):
    counts = dict.fromkeys(("file_bytes", "queue_bytes", "queue_limit_bytes"), 0) | {"file": "", "free_bytes": None}
    fields = {"state": state, "reason": reason, "lost": lost, "entries": 12, "total_bytes": 3_000_000, "stamp": STAMP}
    recorder = RecordStatus.model_validate(fields | counts)
    with StringIO() as screen:
        Console(file=screen, width=120).print(render("mk1", picture_of("record/status", recorder)))
        assert words in screen.getvalue()


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


async def test_people_read_what_happens_when_it_changes(manager):
    channel, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "6000"})
    lines = iter(["link absent", "link absent", "link up:\nproven", *["link up: proven"] * 1000])
    received = await feed(notifier, lambda: 7, lambda: [channel.recv(64) for _ in range(3)], lambda: next(lines))
    assert received == [b"READY=1", b"STATUS=link absent", b"STATUS=link up: proven"]


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


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "/nowhere/at/all"}])
def test_without_a_manager_nothing_happens(environment):
    Notifier(environment).send("READY=1")


def test_abstract_addresses_are_understood():
    name = f"\0mkdaemon-test-{id(object())}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(name)
        channel.settimeout(60)
        Notifier({"NOTIFY_SOCKET": "@" + name[1:]}).send("READY=1")
        assert channel.recv(64) == b"READY=1"
