"""Logging holds up and ends nothing: the queue alone, and a whole daemon whose standard error is blocked or broken."""

from __future__ import annotations

import asyncio
import fcntl
import json
import os
import signal
import sys
import threading
from contextlib import asynccontextmanager, suppress

import pytest
import structlog

from lab.rigs.processes import connected
from lab.rigs.waiting import PATIENCE, wait_blocking
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.cli.mkdaemon import logqueue
from mkdaemon.cli.mkdaemon.logqueue import LogQueue
from mkdaemon.cli.mkdaemon.logs import BURST, LONGEST, KindLimit, shorten_values
from mkdaemon.errors import CommandRejectedError

PIPE_SIZE = 4096


def small_pipe() -> tuple[int, int]:
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, PIPE_SIZE)
    return reading, writing


def test_text_arrives_in_order():
    reading, writing = small_pipe()
    stream = LogQueue(writing)
    for number in range(10):
        print(f"line {number}", file=stream)
    stream.drain(PATIENCE)
    assert os.read(reading, PIPE_SIZE).decode().splitlines() == [f"line {number}" for number in range(10)]


def test_a_reader_that_stands_still_costs_text_and_no_time():
    reading, writing = small_pipe()
    stream = LogQueue(writing)
    line = "x" * 999 + "\n"
    done = threading.Event()

    def flood() -> None:
        for _ in range(2000):
            stream.write(line)
        done.set()

    threading.Thread(target=flood, daemon=True).start()
    assert done.wait(PATIENCE)
    stream.drain(0.01)
    stream._credit = logqueue.BURST
    received = b""

    def read_all() -> bool:
        nonlocal received
        received += os.read(reading, 1 << 16)
        return len(received) >= logqueue.CAPACITY - 1000

    wait_blocking(read_all)
    stream.write("at last\n")
    stream.drain(PATIENCE)
    received += os.read(reading, 1 << 16)
    assert b"texts dropped" in received
    assert received.endswith(b"at last\n")


@pytest.mark.parametrize("target", ["nobody reads", "full disk"])
def test_errors_of_the_descriptor_are_swallowed(target):
    if target == "full disk":
        writing = os.open("/dev/full", os.O_WRONLY)
    else:
        reading, writing = os.pipe()
        os.close(reading)
    stream = LogQueue(writing)
    stream.write("lost\n")
    stream.drain(PATIENCE)
    assert stream._dropped == 1


def test_lines_of_one_kind_are_limited_and_counted(monkeypatch):
    now = 100.0
    monkeypatch.setattr("mkdaemon.cli.mkdaemon.logs.time.monotonic", lambda: now)
    limit, written = KindLimit(), []

    def log(name: str, **fields: object) -> None:
        try:
            written.append(limit(None, "info", {"event": name, **fields}))
        except structlog.DropEvent:
            return

    for number in range(1000):
        log("command", status="denied", key=f"do/{number}")
    log("mode")
    assert [line["event"] for line in written] == ["command"] * int(BURST) + ["mode"]
    now += 1.0
    log("command", status="denied", key="do/lease")
    assert written[-1] == {
        "event": "command", "status": "denied", "key": "do/lease", "left_out": 1000 - int(BURST),
    }  # fmt: skip
    for number in range(1000):
        log(f"kind {number}")
    assert len(written) < 300


def test_long_values_are_cut():
    event = shorten_values(None, "", {"event": "command", "fields": {str(n): n for n in range(256)}, "n": 3})
    assert len(event["fields"]) == LONGEST + 3
    assert event["n"] == 3


@asynccontextmanager
async def daemon_without_port(errors: int):
    """A daemon that waits for its port, and a client; ends in order."""
    with reserved_endpoint() as endpoint:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "mkdaemon.cli.mkdaemon.app", "run", "--port", "/dev/ttyNONE", "--wait"),
            *("--vehicle", "stories", "--listen", endpoint),
            stdout=asyncio.subprocess.DEVNULL,
            stderr=errors,
        )
        try:
            async with connected(endpoint) as vehicle:
                yield vehicle
            process.send_signal(signal.SIGTERM)
            assert await asyncio.wait_for(process.wait(), PATIENCE) == 0
        finally:
            if process.returncode is None:
                process.kill()


async def _flood(vehicle) -> int:
    """Ask for things that are refused and logged; returns how many were answered."""
    for number in range(100):
        answer = await vehicle.command("do", f"nothing-{number}", {"x": "y" * 10}, patience=PATIENCE)
        with pytest.raises(CommandRejectedError):
            answer.require()
    return 100


async def test_a_daemon_logs_json_and_goes_on_and_ends_in_order_whatever_becomes_of_its_standard_error():
    """One daemon: read at first, with the kinds limited; then nobody reads; then nobody could."""
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 1 << 20)
    async with daemon_without_port(writing) as vehicle, vehicle.watch("health") as samples:

        async def goes_on() -> None:
            assert await asyncio.wait_for(_flood(vehicle), PATIENCE) == 100
            ages = [(await asyncio.wait_for(anext(samples), PATIENCE)).fields["stamp"]["monotonic"] for _ in range(3)]
            assert ages == sorted(ages)

        await goes_on()
        lines = [json.loads(line) for line in os.read(reading, 1 << 20).decode().splitlines()]
        assert any("vehicle stories on" in line["event"] for line in lines)
        assert BURST <= sum(line["event"] == "command" for line in lines) < 100
        fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, PIPE_SIZE)
        os.set_blocking(writing, False)
        with suppress(BlockingIOError):
            while True:
                os.write(writing, b"x")
        os.set_blocking(writing, True)
        await goes_on()
        os.close(reading)
        await goes_on()
    os.close(writing)
