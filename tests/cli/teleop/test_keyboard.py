from __future__ import annotations

import asyncio
import os
import termios
from collections.abc import Callable, Iterator

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli.keyreader import ANSWER, KeyReader, raw_terminal
from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError
from mkdaemon.cli.mkctl.teleop.keyboard import PATIENCE, QUESTION, Keyboard
from tests.cli.pseudoterminal import PseudoTerminal


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


@pytest.fixture
def screen() -> Iterator[PseudoTerminal]:
    fake = PseudoTerminal()
    yield fake
    fake.close()


def keyboard_of(screen: PseudoTerminal, quit_now: Callable[[], None] = lambda: None) -> Keyboard:
    return Keyboard(screen.near, screen.screen, quit_now, lambda *_: None)


async def test_keyboard_asks_the_terminal_and_is_as_old_as_its_answer(screen: PseudoTerminal) -> None:
    with raw_terminal(screen.near):
        keyboard = keyboard_of(screen)
        now = asyncio.get_running_loop().time()
        assert keyboard.ask(now + 0.1) is None
        await wait_until(lambda: screen.shows(QUESTION))
        screen.type(ANSWER + b"w")
        await wait_until(lambda: keyboard.keys.alive_at is not None)
        state = keyboard.ask(now + 0.2)
        assert state is not None
        assert state.at == keyboard.keys.alive_at
        assert state.values["KEYS_THRUST"] > -1.0
        keyboard.alarm()
        await wait_until(lambda: screen.shows(b"\a"))
        assert screen.shown == 2 * QUESTION + b"\a"
        keyboard.close()


async def test_terminal_that_never_answers_is_refused(screen: PseudoTerminal) -> None:
    with raw_terminal(screen.near):
        keyboard = keyboard_of(screen)
        with pytest.raises(DeviceLostError, match="does not answer"):
            keyboard.ask(asyncio.get_running_loop().time() + PATIENCE + 0.1)
        keyboard.close()


def test_terminal_is_as_before_also_after_a_failure(screen: PseudoTerminal) -> None:
    before = termios.tcgetattr(screen.near)
    with pytest.raises(RuntimeError), raw_terminal(screen.near):
        assert termios.tcgetattr(screen.near) != before
        raise RuntimeError
    assert termios.tcgetattr(screen.near) == before


def hung_up(*_: object) -> bytes:
    raise OSError(5, "Input/output error")


@pytest.mark.parametrize("read", [hung_up, lambda *_: b""])
async def test_terminal_that_was_closed_or_hung_up_is_lost(
    screen: PseudoTerminal, monkeypatch: pytest.MonkeyPatch, read: Callable[..., bytes]
) -> None:
    with raw_terminal(screen.near):
        keyboard = keyboard_of(screen)
        monkeypatch.setattr(os, "read", read)
        screen.type(b"x")
        await wait_until(lambda: not keyboard._is_open)
        with pytest.raises(DeviceLostError, match="was closed"):
            keyboard.ask(asyncio.get_running_loop().time())
