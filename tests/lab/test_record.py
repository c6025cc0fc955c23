"""The campaign about recording: its figures and its verdict."""

from __future__ import annotations

import pytest

from lab.record.kills import ALLOWED, is_kept, sum_up

LEFT = {"entries": 10, "age": 0.5, "missing": 0, "gaps": 0, "unreadable": 0}


@pytest.mark.parametrize(
    ("change", "is_right"),
    [
        ({}, True),
        ({"age": ALLOWED + 0.1}, False),
        ({"missing": 1}, False),
        ({"gaps": 1}, False),
        ({"unreadable": 1}, False),
    ],
)
def test_a_kill_that_costs_too_much_fails_the_campaign(change, is_right):
    figures = sum_up([LEFT, LEFT | change, LEFT])
    assert figures["entries"] == 30
    assert is_kept(figures) is is_right
