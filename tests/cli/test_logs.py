"""Logging holds up and ends nothing: the queue before standard error, and its limits."""

from __future__ import annotations

import fcntl
import os
import threading

import pytest
import structlog

from lab.rigs.waiting import PATIENCE, wait_blocking
from mkdaemon.cli.mkdaemon import logqueue
from mkdaemon.cli.mkdaemon.logqueue import LogQueue
from mkdaemon.cli.mkdaemon.logs import BURST, LONGEST, KindLimit, shorten_values

PIPE_SIZE = 4096


def small_pipe() -> tuple[int, int]:
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, PIPE_SIZE)
    return reading, writing


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
