"""The campaign about recording: its figures and its verdict."""

from __future__ import annotations

import pytest

from lab.record import writing
from lab.record.kills import ALLOWED, is_kept, sum_up

LEFT = {"entries": 10, "age": 0.5, "missing": 0, "gaps": 0, "unreadable": 0}


def test_figures_of_writing_are_those_of_the_same_entries_every_time():
    figures = writing.measure(300)
    assert figures["entries"] == 300
    assert all(figures[name] > 0 for name in ("tap_us", "write_us", "write_json_us", "plain_mcap_us", "read_us"))
    assert figures["bytes_per_entry"] < figures["bytes_per_entry_json"]


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
