"""What the daemon saw on its clock: many looks in one notice, in order, exact to the nanosecond."""

from __future__ import annotations

import pytest

from mkdaemon.record.looks import ACTORS, LONGEST, MOST, Look, LookLog, unpack_looks


def test_looks_come_back_as_they_went_in():
    log = LookLog()
    looks = [Look("control", 1000.1), Look("link", 1000.100000123), Look("", 1000.2), Look("control", 1009.0)]
    for number, look in enumerate(looks):
        log.add(*look)
        if number == 1:
            log.add_backlog(12)
    log.add_backlog(0)
    assert not log.is_empty
    payload, began = log.take()
    assert began == 1000.1
    found = unpack_looks(payload)
    assert found.looks == tuple(looks)
    assert found.backlogs == ((2, 12), (4, 0))
    assert log.is_empty


def test_a_backlog_alone_is_kept_too():
    log = LookLog()
    log.add_backlog(7)
    payload, began = log.take()
    assert began is None
    found = unpack_looks(payload)
    assert (found.looks, found.backlogs) == ((), ((0, 7),))


@pytest.mark.parametrize(
    ("looks", "ends"),
    [
        ([], False),
        ([("a", 0.0)] * MOST, True),
        ([("a", 0.0)] * (MOST - 1), False),
        ([("b", 0.0)] * MOST, False),
        ([("a", -2 * LONGEST)], True),
        ([(str(number), 0.0) for number in range(ACTORS)], True),
    ],
)
def test_a_notice_ends_where_another_one_acts(looks, ends):
    log = LookLog()
    for actor, at in looks:
        log.add(actor, at)
    assert log.ends_with("b", 0.0) is ends
