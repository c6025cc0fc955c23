from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli.keyreader import ANSWER
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.teleop import command
from mkdaemon.cli.mkctl.teleop.command import InputOptions, teleop
from mkdaemon.cli.mkctl.teleop.devices import DeviceState
from mkdaemon.cli.mkctl.teleop.evdevpad import FoundPad
from mkdaemon.cli.mkctl.teleop.keyboard import QUESTION
from mkdaemon.cli.mkctl.teleop.mappings import Learner, save_mapping
from mkdaemon.cli.terminal import guarded_streams
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section
from mkdaemon.errors import MkError
from mkdaemon.virtualtime import run_virtually
from tests.cli.pseudoterminal import own_terminal
from tests.client.fake import VEHICLE, fake_daemon
from tests.client.teleop.pads import FACTS, HIGH, LOW, REST

ANSWERS = {
    "LEFT stick UP": {"ABS_Y": LOW},
    "LEFT stick to the RIGHT": {"ABS_X": HIGH},
    "RIGHT stick UP": {"ABS_RY": LOW},
    "RIGHT stick to the RIGHT": {"ABS_RX": HIGH},
    "ENABLE": {"BTN_TL": 1},
    "RELEASE": {"BTN_EAST": 1},
    "LAND": {"ABS_Z": 255},
    "TRIM LEFT": {"ABS_HAT0X": -1},
}


class ScriptedPad:
    """A pad whose owner does what he is asked for, a moment later, and lets go again."""

    name, facts = "/dev/input/event7", FACTS

    def __init__(self, answers: dict[str, dict[str, int]]) -> None:
        self.shown: list[str] = []
        self._answers = answers
        self._values: dict[str, float] = {**REST, **dict.fromkeys(FACTS.buttons, 0.0)}

    def show(self, line: str) -> None:
        self.shown.append(line)
        for words, values in self._answers.items():
            if words in line:
                loop = asyncio.get_running_loop()
                rest = {control: self._values[control] for control in values}
                loop.call_later(0.5, self._values.update, values)
                loop.call_later(1.0, self._values.update, rest)

    def ask(self, now: float) -> DeviceState:
        return DeviceState(dict(self._values), now)


def learn(answers: dict[str, dict[str, int]]) -> tuple[str, ScriptedPad]:
    async def main() -> tuple[str, ScriptedPad]:
        pad = ScriptedPad(answers)
        return await Learner(pad, "045e:028e", pad.show).learn(), pad  # type: ignore[arg-type]

    return run_virtually(main())


def test_learned_mapping_is_one_that_is_read_back(tmp_path: Path) -> None:
    text, _ = learn(ANSWERS)
    pad = load_section(Gamepad, save_mapping(tmp_path / "new", "Test pad!", text))
    assert pad.ids == ("045e:028e",)
    assert pad.sticks is not None
    assert pad.sticks.model_dump() == {
        "left_x": "ABS_X", "left_y": "-ABS_Y", "right_x": "ABS_RX", "right_y": "-ABS_RY"
    }  # fmt: skip
    given = {key: value for key, value in pad.buttons.model_dump().items() if value is not None}
    assert given == {"enable": "BTN_TL", "release": "BTN_EAST", "land": "ABS_Z+", "trim_left": "ABS_HAT0X-"}
    assert (tmp_path / "new" / "test-pad.toml").is_file()


@pytest.mark.parametrize("missing", ["RIGHT stick UP", "ENABLE"])
def test_stick_or_enable_button_that_is_not_shown_ends_it(missing: str) -> None:
    with pytest.raises(MkError, match=missing):
        learn({words: values for words, values in ANSWERS.items() if words != missing})


def test_button_with_a_meaning_already_is_not_taken_twice() -> None:
    text, pad = learn({**ANSWERS, "RELEASE": {"BTN_TL": 1}})
    assert 'release = "' not in text
    assert any("is already used" in line for line in pad.shown)


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
