from __future__ import annotations

from pathlib import Path

import pytest

from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section
from mkdaemon.errors import ConfigError
from tests.places import ROOT

RIGHT = """name = "Pad"
ids = ["045e:028e"]

[sticks]
left_x = "ABS_X"
left_y = "-ABS_Y"
right_x = "ABS_RX"
right_y = "-ABS_RY"

[buttons]
enable = "BTN_TL"
"""


def read(folder: Path, text: str) -> Gamepad:
    path = folder / "pad.toml"
    path.write_text(text, encoding="utf-8")
    return load_section(Gamepad, path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("enable", "enabel", r"pad.toml:11: buttons.enabel: unknown key; did you mean \"enable\"\?"),
        ('"045e:028e"', '"45E:28E"', r"pad.toml:2: ids.0: .*pattern"),
        ('"ABS_X"', '"abs x"', r'sticks.left_x: "abs x" will not do. Left stick, right positive'),
        ('"ABS_X"', '"ABS_Y"', "axis ABS_Y is used twice"),
        ('"BTN_TL"\n', '"BTN_TL"\nstop = "BTN_TL"\n', "button BTN_TL is used twice"),
        ('"BTN_TL"\n', '"BTN_TL"\n[thrust]\nhover = 50\n', "does not hold"),
        ('"BTN_TL"\n', '"BTN_TL"\n[pitch]\nexpo = 2\n', "pitch.expo: must be at most 1, not 2"),
        ('name = "Pad"', 'name = "Pad"\nmode = 5', "mode: 1, 2, 3 or 4 is needed, not 5"),
    ],
)
def test_mistake_names_file_place_and_fix(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read(tmp_path, RIGHT.replace(old, new, 1))


def test_pad_without_axes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"either as \[sticks\] or as \[channels\]"):
        read(tmp_path, 'name = "Pad"\n[buttons]\nenable = "BTN_TL"\n')


FILES = sorted((ROOT / "configs" / "gamepads").glob("*.toml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_mapping_is_right_and_names_controls_of_the_kernel(path: Path) -> None:
    pad = load_section(Gamepad, path)
    ecodes = pytest.importorskip("evdev", reason="evdev is not installed").ecodes.ecodes
    section = pad.sticks or pad.channels
    assert section is not None
    pressed = [name for name in pad.buttons.model_dump().values() if name is not None]
    for name in [*section.model_dump().values(), *pressed]:
        assert name.removeprefix("-").rstrip("+-") in ecodes
    if path.stem != "transmitter":
        assert pad.buttons.release is not None
