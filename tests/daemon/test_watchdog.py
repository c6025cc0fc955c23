"""What the service manager is told, and when it is told nothing."""

from __future__ import annotations

import asyncio
import socket

import pytest

from lab.rigs.waiting import running
from mkdaemon.daemon.watchdog import Notifier, feed_watchdog


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
