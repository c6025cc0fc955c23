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
        ("[motors\n", "not valid TOML"),
        ("name = 'x'\n", "motors: must be given"),
        ("[motors]\n17 = [1, 2, 3, 4]\n", "2: motors.17"),
        ("[motors]\n1 = [1, 2, 3]\n", "2: motors.1.3: must be given"),
        ("[motors]\n1 = [1, 2, 3, 200]\n", "2: motors.1.3: must be at most 127, not 200"),
        ("[motors]\n1 = [1, 2, 3, true]\n", "a whole number is needed, not true"),
        ("name = 'thirteen char'\n[motors]\n1 = [1, 2, 3, 4]\n", "1: name: .*at most 12 characters"),
    ],
)
def test_a_bad_file_is_one_line_with_the_fix(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mixer.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        from_toml(file)
    assert str(caught.value).startswith(f"{file}:")
