from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.cli.mkctl.mixer import from_toml, to_toml
from mkdaemon.errors import ConfigError

QUADRO = (64, 64, 0, 64, 64, -64, 0, 64, 64, 0, -64, -64, 64, 0, 64, -64) + (0,) * 48


@given(
    motors=st.lists(st.integers(-128, 127), min_size=64, max_size=64).filter(any),
    name=st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=12),
)
def test_a_mixer_survives_its_file(tmp_path_factory: pytest.TempPathFactory, motors: list[int], name: str) -> None:
    file = tmp_path_factory.mktemp("mixer") / "mixer.toml"
    file.write_text(to_toml(name, tuple(motors)))
    back = from_toml(file)
    assert (back.name, back.motors) == (name, tuple(motors))


def test_rows_without_a_motor_are_left_out() -> None:
    assert to_toml("Quadro", QUADRO).splitlines()[3:] == [
        "1 = [64, 64, 0, 64]",
        "2 = [64, -64, 0, 64]",
        "3 = [64, 0, -64, -64]",
        "4 = [64, 0, 64, -64]",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[motors\n", "no TOML: .*`mkctl board mixer read FILE` writes one"),
        ("name = 'x'\n", r"no table \[motors\]"),
        ("[motors]\n17 = [1, 2, 3, 4]\n", "motor '17'; motors are 1 to 16"),
        ("[motors]\n1 = [1, 2, 3]\n", r"motor 1 is \[1, 2, 3\]; write \[throttle, pitch, roll, yaw\]"),
        ("[motors]\n1 = [1, 2, 3, 200]\n", r"each -128\.\.127"),
        ("[motors]\n1 = [1, 2, 3, true]\n", r"each -128\.\.127"),
        ("name = 'thirteen char'\n[motors]\n1 = [1, 2, 3, 4]\n", "at most 12 ASCII characters"),
    ],
)
def test_a_bad_file_is_one_line_with_the_fix(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mixer.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        from_toml(file)
    assert str(caught.value).startswith(f"{file}: ")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot be read \(No such file or directory\)"):
        from_toml(tmp_path / "none.toml")
