"""The guard's hand on a port: what it does where the port is full, cut, gone or shut."""

from __future__ import annotations

import os
import socket
import tty

import pytest

from mkdaemon.guard import RESYNC, PortLine

FRAME = b"#frame\r"


@pytest.fixture
def pair():
    near, far = socket.socketpair()
    for end in (near, far):
        end.setblocking(False)
    yield near, far
    for end in (near, far):
        end.close()


def test_a_frame_goes_out_as_it_is(pair):
    near, far = pair
    line = PortLine()
    line.replace(os.dup(near.fileno()))
    assert line.write((RESYNC, FRAME))
    assert line.write((FRAME,))
    assert far.recv(100) == RESYNC + FRAME + FRAME
    line.replace(-1)


def test_without_a_port_nothing_is_written_and_nothing_fails():
    line = PortLine()
    assert not line.write((FRAME,))
    line.discard_waiting()


@pytest.mark.parametrize("descriptor", [0, 1, 99])
def test_every_descriptor_from_0_on_is_a_port(monkeypatch, descriptor):
    written, asked, closed = [], [], []
    monkeypatch.setattr(os, "write", lambda number, data: written.append((number, data)) or len(data))
    monkeypatch.setattr("mkdaemon.guard.fcntl.ioctl", lambda number, *_: asked.append(number))
    monkeypatch.setattr(os, "close", closed.append)
    line = PortLine()
    assert line.descriptor == -1
    line.replace(descriptor)
    assert line.write((FRAME,))
    line.discard_waiting()
    line.replace(-1)
    line.replace(-1)
    assert (written, asked, closed) == ([(descriptor, FRAME)], [descriptor], [descriptor])


def test_a_device_that_does_not_tell_what_waits_is_not_emptied(monkeypatch):
    def ioctl(*_):
        raise OSError

    flushed = []
    monkeypatch.setattr("mkdaemon.guard.fcntl.ioctl", ioctl)
    monkeypatch.setattr("mkdaemon.guard.termios.tcflush", lambda *what: flushed.append(what))
    line = PortLine()
    line.descriptor = 99
    line.discard_waiting()
    assert flushed == []


def test_a_port_that_is_gone_takes_nothing(pair):
    near, far = pair
    line = PortLine()
    line.replace(os.dup(near.fileno()))
    far.close()
    assert not line.write((FRAME,))
    line.replace(-1)


def test_another_descriptor_closes_the_one_before(pair):
    near, _ = pair
    line, first = PortLine(), os.dup(near.fileno())
    line.replace(first)
    line.replace(os.dup(near.fileno()))
    with pytest.raises(OSError, match="Bad file"):
        os.fstat(first)
    line.replace(-1)
    assert line.descriptor == -1


def test_a_frame_after_one_that_was_cut_is_led_by_what_ends_it(monkeypatch):
    written = []

    def write(descriptor, data):
        written.append(data)
        return len(data) - (len(written) == 1)

    monkeypatch.setattr(os, "write", write)
    line = PortLine()
    line.descriptor = 99
    assert not line.write((FRAME,))
    assert line.write((FRAME,))
    assert line.write((FRAME,))
    assert written == [FRAME, RESYNC + FRAME, FRAME]


@pytest.mark.parametrize("is_full", [1, 2])
def test_a_full_port_is_emptied_and_tried_once_more(monkeypatch, is_full):
    flushed, written = [], []

    def write(descriptor, data):
        written.append(data)
        if len(written) <= is_full:
            raise BlockingIOError
        return len(data)

    monkeypatch.setattr(os, "write", write)
    monkeypatch.setattr("mkdaemon.guard.termios.tcflush", lambda *what: flushed.append(what))
    line = PortLine()
    line.descriptor = 99
    assert line.write((FRAME,)) is (is_full == 1)
    assert written == [FRAME, RESYNC + FRAME]
    assert len(flushed) == is_full
    assert line.write((FRAME,))
    assert written[2:] == [FRAME if is_full == 1 else RESYNC + FRAME]


@pytest.mark.parametrize("size", [0, 1, 100])
def test_only_what_waits_in_the_device_is_thrown_away(monkeypatch, size):
    flushed = []

    def ioctl(descriptor, request, number):
        number[0] = size

    monkeypatch.setattr("mkdaemon.guard.fcntl.ioctl", ioctl)
    monkeypatch.setattr("mkdaemon.guard.termios.tcflush", lambda *what: flushed.append(what))
    written = []
    monkeypatch.setattr(os, "write", lambda descriptor, data: written.append(data) or len(data))
    line = PortLine()
    line.descriptor = 99
    line.discard_waiting()
    line.write((FRAME,))
    assert bool(flushed) is (size > 0)
    assert written == [RESYNC + FRAME if size else FRAME]


def test_what_a_pseudo_terminals_reader_has_not_fetched_stays():
    far, near = os.openpty()
    tty.setraw(near)
    line = PortLine()
    line.replace(near)
    assert line.write((FRAME,))
    line.discard_waiting()
    assert line.write((FRAME,))
    got = os.read(far, 100)
    while len(got) < 2 * len(FRAME):  # a worker of the kernel carries them
        got += os.read(far, 100)
    assert got == FRAME + FRAME
    line.replace(-1)
    os.close(far)
