"""Pictures are drawn from kept results; what is missing is named with the command that makes it."""

from __future__ import annotations

import pytest

from lab import figures
from lab.figures import PLOTS, main
from mkdaemon.errors import ConfigError, MkError
from tests.places import CONFIGS

NESTED = CONFIGS / "targets" / "nested.toml"


@pytest.fixture(autouse=True)
def sheets(monkeypatch):
    """The sheet is rendered in tests/mksim/scene/test_sheet.py; here it is only asked for."""
    drawn = []
    monkeypatch.setattr(figures, "contact_sheet", lambda target, path: drawn.append((target.name, path)))
    return drawn


def test_missing_results_name_their_benchmarks_and_the_rest_is_drawn(tmp_path, sheets):
    with pytest.raises(MkError) as caught:
        main(results=tmp_path, out=tmp_path / "figures", target=NESTED)
    assert all(f"python -m lab {plot.benchmark}" in str(caught.value) for plot in PLOTS)
    assert sheets == [("pad", tmp_path / "figures" / "scene_conditions.png")]


@pytest.mark.parametrize("text", ["", "no json", "[1]"])
def test_a_broken_result_is_named(tmp_path, text):
    (tmp_path / "link.json").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"link\.json"):
        main(results=tmp_path, out=tmp_path / "figures", target=NESTED)
