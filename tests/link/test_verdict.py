"""A verdict: when its condition began, and what it stands on."""

from __future__ import annotations

import pytest

from mkdaemon.link.session.verdict import HeldFinding, VerdictCause, VerdictFinding
from mkdaemon.telemetry.link import LinkCondition


def test_another_reason_for_the_same_condition_does_not_begin_it_anew():
    first = HeldFinding(VerdictFinding(LinkCondition.DEGRADED, "osd is overdue"), 1.0)
    second = first.followed_by(VerdictFinding(LinkCondition.DEGRADED, "12 % damaged"), 2.0, 2.0)
    assert (second.condition, second.reason, second.since) == (LinkCondition.DEGRADED, "12 % damaged", 1.0)


def test_another_condition_begins_when_it_is_found():
    first = HeldFinding(VerdictFinding(LinkCondition.UP, "both directions proven"), 1.0)
    second = first.followed_by(VerdictFinding(LinkCondition.DOWN, "stuck", VerdictCause.PORT_STUCK), 2.0, 2.0)
    assert (second.condition, second.cause, second.since) == (LinkCondition.DOWN, VerdictCause.PORT_STUCK, 2.0)


def test_a_silence_begins_when_the_board_was_heard_last_and_goes_on_under_another_name():
    up = VerdictFinding(LinkCondition.UP, "both directions proven")
    mute, garbage = VerdictFinding(LinkCondition.MUTE, "nothing"), VerdictFinding(LinkCondition.GARBAGE, "no frame")
    stuck = VerdictFinding(LinkCondition.DOWN, "stuck", VerdictCause.PORT_STUCK)
    verdict = HeldFinding(up, 1.0).followed_by(mute, 2.0, 1.6)
    assert (verdict.since, verdict.silent_since) == (2.0, 1.6)
    verdict = verdict.followed_by(garbage, 3.0, 1.6).followed_by(stuck, 4.0, 4.0)
    assert (verdict.since, verdict.silent_since, verdict.is_outage) == (4.0, 1.6, True)
    assert verdict.followed_by(up, 5.0, 5.0).silent_since > 1e9


@pytest.mark.parametrize("condition", LinkCondition)
def test_a_condition_says_what_it_means(condition: LinkCondition):
    usable = condition in {LinkCondition.UP, LinkCondition.DEGRADED}
    assert condition.is_usable is usable
    assert condition.hears_board is (usable or condition is LinkCondition.ONE_WAY)
    assert condition.is_silent is (condition in {LinkCondition.MUTE, LinkCondition.GARBAGE})
