"""Who lost a conversation: the radio or us, and how sure that is."""

from __future__ import annotations

import pytest

from lab.link.cases import CASES
from lab.link.fates import Fate, echo_account, stick_account, upper_bound
from lab.link.main import play
from mkdaemon.virtualtime import run_virtually

GOOD = Fate(1.0, arrived=1.02, taken=1.021, answered=1.03, heard=1.05)
NOT_THERE = Fate(1.0)
NOT_BACK = Fate(1.0, arrived=1.02, answered=1.03)
UNANSWERED = Fate(1.0, arrived=1.02)
LATE = Fate(1.0, arrived=1.02, answered=1.03, heard=1.3)


@pytest.mark.parametrize(
    ("fate", "lost", "by_radio", "by_us"),
    [(GOOD, 0, 0, 0), (NOT_THERE, 1, 1, 0), (NOT_BACK, 1, 1, 0), (UNANSWERED, 1, 0, 1), (LATE, 1, 0, 1)],
)
def test_a_lost_link_test_is_ours_unless_the_radio_took_a_packet(fate, lost, by_radio, by_us):
    account = echo_account([GOOD, fate])
    assert [account[name] for name in ("sent", "lost", "by_radio", "by_us")] == [2, lost, by_radio, by_us]


def test_a_stick_frame_never_sent_or_not_taken_is_ours():
    assert stick_account([GOOD, GOOD], handed_in=2)["by_us"] == 0
    assert stick_account([GOOD, NOT_THERE], handed_in=2)["by_radio"] == 1
    assert stick_account([GOOD, NOT_THERE], handed_in=2)["by_us"] == 0
    assert stick_account([GOOD, UNANSWERED], handed_in=2)["by_us"] == 1  # it arrived, and nobody took it
    assert stick_account([GOOD], handed_in=2)["by_us"] == 1


@pytest.mark.parametrize(
    ("hits", "trials", "expected"),  # beta quantile at 0.95 of (hits + 1, trials - hits)
    [(0, 1500, 0.0019951), (0, 6000, 0.00049917), (1, 100, 0.046556), (5, 1000, 0.0104840), (3, 3, 1.0), (0, 0, 1.0)],
)
def test_the_bound_is_that_of_clopper_and_pearson(hits, trials, expected):
    assert upper_bound(hits, trials) == pytest.approx(expected, rel=2e-4)


def test_by_radio_every_loss_of_a_short_run_is_the_radios():
    proof = run_virtually(play(CASES["radio_15"], 12.0))["proof"]
    assert proof["control"]["sent"] == 180
    assert proof["echo"]["sent"] > 110
    assert proof["echo"]["by_us"] == proof["control"]["by_us"] == 0
