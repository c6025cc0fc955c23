from __future__ import annotations

import asyncio

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli.keyreader import ANSWER
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.teleop import command
from mkdaemon.cli.mkctl.teleop.command import InputOptions, teleop
from mkdaemon.cli.mkctl.teleop.evdevpad import FoundPad
from mkdaemon.cli.mkctl.teleop.keyboard import QUESTION
from mkdaemon.cli.terminal import guarded_streams
from mkdaemon.errors import MkError
from tests.cli.pseudoterminal import own_terminal
from tests.client.fake import VEHICLE, fake_daemon


async def test_without_the_library_gamepads_are_refused_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise MkError("gamepads need the library evdev")

    monkeypatch.setattr(command, "load_evdev", missing)
    with pytest.raises(MkError, match="evdev"):
        await teleop()


@pytest.mark.parametrize(
    ("pad", "words"),
    [
        (FoundPad("/dev/input/event3", "Pad", "045e:028e"), "045e:028e  Pad  mapping: Xbox pad"),
        (FoundPad("/dev/input/event3", "Pad", "1234:5678"), "no mapping: mkctl teleop --learn"),
        (FoundPad("/dev/input/event3", "?", "", "cannot be opened: Permission denied"), "Permission denied"),
        (None, "no pad: plug one in"),
    ],
)
async def test_list_names_pads_mappings_and_troubles(
    pad: FoundPad | None, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "describe_pads", lambda: [pad] if pad else [])
    assert await teleop(list_=True) == 0
    assert words in capsys.readouterr().out


async def test_keyboard_of_a_program_reaches_its_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is printed is guarded; the question to the terminal and the screen must not be."""
    with own_terminal(monkeypatch, "stdout") as terminal:

        def answered() -> bool:
            if terminal.shows(QUESTION):
                terminal.type(ANSWER)
            return b"hold KEY_E" in terminal.shown or b"pull the thrust stick" in terminal.shown

        async with fake_daemon() as daemon:
            with guarded_streams():
                hands, here = InputOptions(keyboard=True), Connection(VEHICLE, daemon.endpoint)
                flying = asyncio.create_task(teleop(hands=hands, connection=here))
                await wait_until(answered)
                terminal.type(b"q")
                assert await flying == 0
