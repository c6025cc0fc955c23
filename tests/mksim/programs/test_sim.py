"""`mkdaemon sim` as a program: its port, its end, its mistakes."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import time
import tty

import pytest

from lab.rigs.programs import PATIENCE, mkdaemon
from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import run
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mksim.programs import sim

ALONE = ("sim", "--connect", "tcp/127.0.0.1:9")
"""No daemon answers there."""


ASKED = {"o": b"\x0a", "c": b"\x05", "d": b"\x14", "a": b"\x09"}
"""Requests the boards answer, and what they carry: an interval, or the number of a label."""


def talk(port, requests, wanted):
    """Send requests to a pseudo terminal and return the frames that came, until a frame of the letter `wanted` did."""
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(descriptor)
        os.write(descriptor, requests)
        decoder, frames, end = FrameDecoder(), [], time.monotonic() + PATIENCE
        while wanted not in {frame.id for frame in frames}:
            assert time.monotonic() < end, f"no {wanted} among {[frame.id for frame in frames]}"
            if select.select([descriptor], [], [], 0.1)[0]:
                frames += [item for item in decoder.feed(os.read(descriptor, 4096)) if isinstance(item, Frame)]
    finally:
        os.close(descriptor)
    return frames


@pytest.mark.parametrize(("board", "address", "asked"), [("nc", 2, "ocda"), ("fc", 1, "cda")])
def test_the_first_line_names_a_port_that_answers(board, address, asked):
    with mkdaemon(*ALONE, "--board", board) as program:
        port = json.loads(program.stdout.readline())["port"]
        requests = b"\r\r" + encode_frame(0, "v")
        frames = talk(port, requests, "V")
        assert frames[0].address == address
        for letter in asked:
            talk(port, encode_frame(0, letter, ASKED[letter]), letter.upper())
        program.send_signal(signal.SIGTERM)
        assert program.wait(PATIENCE) == 0
        assert program.stderr.read() == ""


@pytest.fixture
def in_this_process(monkeypatch):
    """It goes on, and logs as before."""
    monkeypatch.setattr(sim, "let_signals_kill", lambda: None)
    monkeypatch.setattr(sim, "configure", lambda level: None)


@pytest.fixture
def taken():
    """A TCP port in use."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (("--fc", "9.99"), 2, "sim.fc"),
        (("--config", "no-such.toml"), 2, "no-such.toml"),
        (("--gas", "3"), 2, "--gas"),
        (("--listen", "127.0.0.1:99999"), 2, "sim.listen"),
        (("--listen", "127.0.0.1:{}"), 1, "sim.listen"),
        (("--seconds", "-1"), 2, "--seconds"),
    ],
)
@pytest.mark.usefixtures("in_this_process")
def test_a_mistake_is_one_line(options, code, says, taken, capsys):
    assert run(app, [*ALONE, *(option.format(taken) for option in options)]) == code
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert says in err
