"""The pages that a student and an operator follow: every command is typed, and every answer is the page's."""

from __future__ import annotations

import pytest

from lab.places import ROOT
from lab.rigs.desk import desk
from lab.rigs.walk import is_answer, steps_of, walk

PAGES = ("first-flight.md", "troubles.md")


@pytest.mark.parametrize("page", PAGES)
def test_every_answer_is_that_of_the_page(page, tmp_path):
    with desk(tmp_path) as made:
        assert list(walk(ROOT / "docs" / page, made)) == []


def test_an_operator_meets_twelve_faults():
    text = (ROOT / "docs" / "troubles.md").read_text(encoding="utf-8")
    faults = text.partition("## Twelve faults")[2].partition("## Every message")[0]
    headings = [line for line in faults.splitlines() if line.startswith("### ")]
    typed = [step.typed for step in steps_of(ROOT / "docs" / "troubles.md")]
    assert len(headings) == 12
    assert sum(line.startswith("mkctl sim fault") and "clear" not in line for line in typed) == 9


@pytest.mark.parametrize(
    ("wanted", "lines", "fits"),
    [
        ([], [], True),
        ([], ["more"], False),
        (["battery 16.8 V"], ["battery   12.1 V"], True),
        (["battery 16.8 V"], ["battery 12.1 A"], False),
        (["0 refused"], ["1 refused"], False),
        (["12 refused"], ["1345 refused"], True),
        (["x +0.01 y"], ["x -0.12 y"], True),
        (["...", "b", "..."], ["a", "b", "c"], True),
        (["...", "b"], ["a", "b", "c"], False),
        (["..."], [], True),
        (["it takes ..."], ["it takes a while"], True),
        (["it takes ..."], ["it took a while"], False),
    ],
)
def test_what_an_answer_of_a_page_is(wanted, lines, fits):
    assert is_answer(wanted, lines) is fits
