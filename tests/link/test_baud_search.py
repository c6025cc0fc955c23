"""The search for the line rate: what begins it, what it tries, what ends it."""

from __future__ import annotations

import pytest

from mkdaemon.link.session.reopening import (
    GARBAGE_PATIENCE,
    MUTE_PATIENCE,
    SILENT_PATIENCE,
    STUCK_PATIENCE,
    BaudSearch,
)
from mkdaemon.link.session.verdict import HeldFinding, VerdictCause, VerdictFinding
from mkdaemon.telemetry.link import LinkCondition


def verdict(condition: LinkCondition, cause: VerdictCause = VerdictCause.OTHER) -> HeldFinding:
    """A verdict that has held since 0 s."""
    return HeldFinding(VerdictFinding(condition, "why", cause), 0.0)


@pytest.mark.parametrize(
    ("condition", "patience"), [(LinkCondition.GARBAGE, GARBAGE_PATIENCE), (LinkCondition.MUTE, MUTE_PATIENCE)]
)
def test_garbage_and_a_line_that_never_spoke_begin_a_search(condition: LinkCondition, patience: float):
    search = BaudSearch(57600, enabled=True)
    assert search.reason_to_reopen(verdict(condition), 0.0, patience) is None
    reason = search.reason_to_reopen(verdict(condition), 0.0, patience + 0.01)
    doubt = " (or no board is switched on)" if condition is LinkCondition.MUTE else ""
    assert reason == f"no frame at 57600 baud{doubt}: trying 115200"
    assert search.attempt == VerdictFinding(condition, reason)
    assert search.current == 115200


def test_every_second_attempt_is_the_configured_rate():
    search = BaudSearch(57600, enabled=True)
    tried = []
    for step in range(6):
        opened = 10.0 * step
        search.reason_to_reopen(verdict(LinkCondition.GARBAGE), opened, opened + SILENT_PATIENCE + GARBAGE_PATIENCE)
        tried.append(search.current)
    assert tried == [115200, 57600, 38400, 57600, 19200, 57600]
    assert search.attempt is not None
    assert search.attempt.condition is LinkCondition.GARBAGE


def test_plain_text_is_no_wrong_line_rate():
    search = BaudSearch(57600, enabled=True)
    assert search.reason_to_reopen(verdict(LinkCondition.GARBAGE, VerdictCause.PLAIN_TEXT), 0.0, 60.0) is None


def test_silence_after_a_board_was_heard_is_no_wrong_line_rate():
    search = BaudSearch(57600, enabled=True)
    assert search.reason_to_reopen(verdict(LinkCondition.UP), 0.0, 1.0) is None
    assert search.reason_to_reopen(verdict(LinkCondition.MUTE), 0.0, 60.0) is None


def test_a_frame_ends_the_search():
    search = BaudSearch(57600, enabled=True)
    search.reason_to_reopen(verdict(LinkCondition.GARBAGE), 0.0, 5.0)
    assert search.reason_to_reopen(verdict(LinkCondition.ONE_WAY), 5.0, 5.1) is None
    assert search.attempt is None
    assert search.current == 115200


def test_a_stuck_port_is_opened_anew_at_the_same_rate():
    search = BaudSearch(57600, enabled=False)
    stuck = verdict(LinkCondition.DOWN, VerdictCause.PORT_STUCK)
    assert search.reason_to_reopen(stuck, 0.0, STUCK_PATIENCE) is None
    assert search.reason_to_reopen(stuck, 0.0, STUCK_PATIENCE + 0.01) == "why"
    assert search.current == 57600
