"""`mkdaemon calibrate print`: prints from files, tags and boards; mistakes are one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_OK, run
from mkdaemon.vision.tags.targetfile import load
from tests.places import CONFIGS


def target(*words: object) -> int:
    return run(app, ["calibrate", "print", *(str(word) for word in words)])


@pytest.mark.parametrize(
    ("words", "width"),
    [
        (("--target", CONFIGS / "targets" / "nested.toml"), 304.8 * 10 / 8 + 26),
        (("--tag", "7:0.16"), 160 * 10 / 8 + 26),
        (("--tag", "tag25h9/3:0.14"), 140 * 9 / 7 + 26),
        (("--charuco", "9x6", "--square", "0.03"), 270 + 26),
    ],
)
@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_every_kind_is_printed_in_its_size(
    words: tuple[object, ...], width: float, suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert target(tmp_path / f"x.{suffix}", *words, "--json") == EXIT_OK
    told = json.loads(capsys.readouterr().out)
    assert told["width_mm"] == pytest.approx(width, abs=0.01)
    assert Path(told["file"]).stat().st_size > 1000


def test_the_target_file_beside_a_print_describes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "own.toml"
    assert target(tmp_path / "x.svg", "--tag", "48:0.2", "--tag", "1:0.032", "--write-target", file) == EXIT_OK
    assert "measure the ruler" in capsys.readouterr().out
    (own,) = load([file]).targets
    assert [(tag.tag_id, tag.size) for tag in own.tags] == [(48, 0.2), (1, 0.032)]
    np.testing.assert_array_equal(own.tags[1].position, 0.0)
