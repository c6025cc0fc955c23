from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section
from tests.places import ROOT

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


def test_every_pad_has_one_mapping() -> None:
    ids = Counter(id_ for path in FILES for id_ in load_section(Gamepad, path).ids)
    assert ids
    assert {id_: count for id_, count in ids.items() if count > 1} == {}


@pytest.mark.parametrize(
    "id_", ["045e:028e", "045e:0b12", "054c:09cc", "054c:0ce6", "046d:c21d", "046d:c216", "046d:c21f", "046d:c219",
            "28de:1102", "28de:1205", "2dc8:6006"]
)  # fmt: skip
def test_common_pads_are_known(id_: str) -> None:
    assert any(id_ in load_section(Gamepad, path).ids for path in FILES)
