"""The pages that a student and an operator follow: every command is typed, and every answer is the page's."""

from __future__ import annotations

import pytest

from lab.places import ROOT
from lab.rigs.desk import desk
from lab.rigs.walk import walk

PAGES = ("first-flight.md", "troubles.md")


@pytest.mark.parametrize("page", PAGES)
def test_every_answer_is_that_of_the_page(page, tmp_path):
    with desk(tmp_path) as made:
        assert list(walk(ROOT / "docs" / page, made)) == []
