from __future__ import annotations

import asyncio
import io
import os
import pty
import termios
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli.keyreader import ANSWER, KeyReader, raw_terminal
from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError
from mkdaemon.cli.mkctl.teleop.keyboard import PATIENCE, QUESTION, Keyboard


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"we", ["w", "e"]),
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
        (b"\x1bOA", ["up"]),
        (b"\x1b[1;2A", ["up"]),
        (b"\x1b[0n", ["alive"]),
        (b"a\x1b[0nb", ["a", "alive", "b"]),
        (b"\x1b[15~x", ["x"]),
        (b"\xff", ["\xff"]),
    ],
)
def test_keys_are_found_whatever_way_they_are_cut(data: bytes, keys: list[str]) -> None:
    assert list(KeyReader().feed(data)) == keys
    for cut in range(len(data) + 1):
        reader = KeyReader()
        assert [*reader.feed(data[:cut]), *reader.feed(data[cut:])] == keys


class FakeTerminal:
    """Both ends of a pseudo terminal."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        os.set_blocking(self.master, False)
        self.screen = os.fdopen(os.dup(self.slave), "w")

    def type(self, data: bytes) -> None:
        os.write(self.master, data)

    async def wait_for(self, expected: bytes) -> None:
        """Wait until exactly this was written; a worker of the kernel carries it."""
        shown = bytearray()

        def has_come() -> bool:
            with suppress(BlockingIOError):
                shown.extend(os.read(self.master, 65536))
            return len(shown) >= len(expected)

        await wait_until(has_come)
        assert shown == expected

    def keyboard(self, quit_now: Callable[[], None] = lambda: None) -> Keyboard:
        return Keyboard(self.slave, self.screen, quit_now, lambda *_: None)


@pytest.fixture
def screen() -> Iterator[FakeTerminal]:
    fake = FakeTerminal()
    yield fake
    fake.screen.close()
    os.close(fake.master)
    os.close(fake.slave)


async def test_keyboard_asks_the_terminal_and_is_as_old_as_its_answer(screen: FakeTerminal) -> None:
    with raw_terminal(screen.slave):
        keyboard = screen.keyboard()
        now = asyncio.get_running_loop().time()
        assert keyboard.ask(now + 0.1) is None
        await screen.wait_for(QUESTION)
        screen.type(ANSWER + b"w")
        await wait_until(lambda: keyboard.keys.alive_at is not None)
        state = keyboard.ask(now + 0.2)
        assert state is not None
        assert state.at == keyboard.keys.alive_at
        assert state.values["KEYS_THRUST"] > -1.0
        keyboard.alarm()
        await screen.wait_for(QUESTION + b"\a")
        keyboard.close()


async def test_terminal_that_never_answers_is_refused(screen: FakeTerminal) -> None:
    with raw_terminal(screen.slave):
        keyboard = screen.keyboard()
        with pytest.raises(DeviceLostError, match="does not answer"):
            keyboard.ask(asyncio.get_running_loop().time() + PATIENCE + 0.1)
        keyboard.close()


async def test_closed_terminal_is_lost(screen: FakeTerminal, monkeypatch: pytest.MonkeyPatch) -> None:
    with raw_terminal(screen.slave):
        keyboard = screen.keyboard()
        monkeypatch.setattr(os, "read", lambda *_: b"")
        screen.type(b"x")
        loop = asyncio.get_running_loop()
        await wait_until(lambda: not keyboard._is_open)
        with pytest.raises(DeviceLostError, match="was closed"):
            keyboard.ask(loop.time())


@pytest.mark.parametrize("key", [b"q", b"\x04"])
async def test_quit_keys_end_the_program(screen: FakeTerminal, key: bytes) -> None:
    ended = asyncio.Event()
    with raw_terminal(screen.slave):
        keyboard = screen.keyboard(ended.set)
        screen.type(key)
        async with asyncio.timeout(5):
            await ended.wait()
        keyboard.close()


def test_terminal_is_as_before_also_after_a_failure(screen: FakeTerminal) -> None:
    before = termios.tcgetattr(screen.slave)
    with pytest.raises(RuntimeError), raw_terminal(screen.slave):
        assert termios.tcgetattr(screen.slave) != before
        raise RuntimeError
    assert termios.tcgetattr(screen.slave) == before


class BrokenScreen(io.StringIO):
    """A terminal that nothing can be written to."""

    def write(self, text: str) -> int:
        raise OSError(5, "Input/output error")


async def test_terminal_that_was_hung_up_is_lost(screen: FakeTerminal, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> bytes:
        raise OSError(5, "Input/output error")

    with raw_terminal(screen.slave):
        keyboard = screen.keyboard()
        monkeypatch.setattr(os, "read", fail)
        screen.type(b"x")
        await wait_until(lambda: not keyboard._is_open)
        monkeypatch.undo()
        other = screen.keyboard()
        other._screen = BrokenScreen()
        with pytest.raises(DeviceLostError, match="terminal is gone"):
            other.ask(asyncio.get_running_loop().time() + 0.1)
        other.close()
