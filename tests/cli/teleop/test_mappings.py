from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from mkdaemon.cli.mkctl.teleop.devices import DeviceState
from mkdaemon.cli.mkctl.teleop.mappings import Learner, save_mapping
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section
from mkdaemon.errors import MkError
from mkdaemon.virtualtime import run_virtually
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
