"""What the guard owes the aircraft, as lists of events; the process itself is tested in test_process.py."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon import guard as program
from mkdaemon.guard import NEUTRAL_AFTER, RELEASE_AFTER, RELEASE_TIME, RESYNC, Guard, Word

FRAMES = Word.FRAMES + json.dumps([b"#release\r".hex(), b"#other\r".hex()]).encode()
NEUTRAL = b"#neutral\r"
BEAT = Word.BEAT + NEUTRAL


def run(events, until, step=0.005):
    """Everything a guard writes, with its time, for packets at their times."""
    guard, written, now, left = Guard(), [], 0.0, sorted(events, key=lambda event: event[0])
    while now <= until:
        while left and left[0][0] <= now:
            guard.hear(left.pop(0)[1], now)
        frames = guard.due(now)
        if frames:
            written.append((now, b"".join(frames)))
        now = round(now + step, 9)
    return guard, written


def beats(until, period=0.02):
    return [(k * period, BEAT) for k in range(int(until / period) + 1)]


def test_regular_beats_need_nothing():
    guard, written = run([(0, FRAMES), *beats(10.0)], 10.0)
    assert written == []
    assert guard.is_armed


def test_a_guard_that_was_never_armed_sends_nothing_and_ends_with_the_daemon():
    guard, written = run([(0, FRAMES), (1.0, b"")], 5.0)
    assert written == []
    assert guard.is_over


def test_silence_is_neutral_then_released():
    guard, written = run([(0, FRAMES), *beats(1.0)], 5.0)
    neutral = [at for at, data in written if NEUTRAL in data]
    released = [at for at, data in written if b"#release" in data]
    assert 1.0 + NEUTRAL_AFTER <= neutral[0] <= 1.0 + NEUTRAL_AFTER + 0.02
    assert written[0][1] == RESYNC + NEUTRAL
    assert 1.0 + RELEASE_AFTER <= released[0] <= 1.0 + RELEASE_AFTER + 0.04
    assert released[-1] <= released[0] + RELEASE_TIME
    assert max(neutral) < min(released)
    assert not guard.is_over, "the daemon may only be frozen"


def test_release_frames_of_all_layouts_take_turns():
    _, written = run([(0, FRAMES), *beats(0.1)], 5.0)
    sent = [data for _, data in written if NEUTRAL not in data]
    assert sent[:4] == [b"#release\r", b"#other\r"] * 2
    assert len(sent) >= 30


def test_a_dead_daemon_is_released_at_once():
    guard, written = run([(0, FRAMES), *beats(1.0), (1.005, b"")], 5.0)
    assert written[0] == (1.005, RESYNC + NEUTRAL)
    assert written[1][1] == b"#release\r"
    assert written[1][0] <= 1.035
    assert guard.is_over


def test_a_short_stall_ends_with_the_next_beat():
    guard, written = run([(0, FRAMES), *beats(1.0), (1.5, BEAT), (1.6, BEAT), (1.7, Word.SAFE)], 5.0)
    assert {data for _, data in written} <= {RESYNC + NEUTRAL, NEUTRAL}
    assert not guard.is_armed


def test_beats_do_not_stop_a_release_that_has_begun():
    guard, written = run([(0, FRAMES), *beats(0.5), *[(1.4 + t, BEAT) for t, _ in beats(1.0)]], 5.0)
    released = [at for at, data in written if b"#release" in data or b"#other" in data]
    assert released[-1] - released[0] >= RELEASE_TIME - 0.1
    assert guard.is_releasing


def test_after_safe_a_new_flight_is_watched_again():
    events = [(0, FRAMES), *beats(0.5), (3.0, Word.SAFE), (4.0, BEAT)]
    _, written = run(events, 4.5)
    again = next(entry for entry in written if entry[0] > 4.0)
    assert again == (pytest.approx(4.25, abs=0.01), RESYNC + NEUTRAL)


def test_an_orderly_end_sends_nothing():
    guard, written = run([(0, FRAMES), *beats(0.5), (0.51, Word.SAFE), (0.52, Word.END), (0.53, b"")], 3.0)
    assert written == []
    assert guard.is_over


@given(
    st.lists(
        st.tuples(
            st.floats(0, 5), st.sampled_from([BEAT, Word.SAFE, FRAMES, Word.PING, Word.CLOSED, b"?x", b"H", b""])
        ),
        max_size=40,
    )
)
def test_any_order_of_packets_sends_only_the_frames_it_was_given(events):
    _, written = run([(0, FRAMES), *events], 8.0, step=0.02)
    allowed = {b"#release\r", b"#other\r", NEUTRAL, RESYNC + NEUTRAL, RESYNC, b""}
    assert {data for _, data in written} <= allowed
    if not any(packet[:1] == Word.BEAT for _, packet in events):
        assert written == []


@pytest.mark.parametrize(("granted", "taken"), [(2, ("rr", 2)), (1, ("rr", 1)), (0, ("nice", program.NICE))])
def test_it_takes_the_best_priority_that_the_system_grants(monkeypatch, granted, taken):
    found = []

    def schedule(process, policy, parameters):
        if parameters.sched_priority > granted:
            raise PermissionError
        found.append(("rr", parameters.sched_priority))

    monkeypatch.setattr(program.os, "sched_setscheduler", schedule)
    monkeypatch.setattr(program.os, "setpriority", lambda which, process, nice: found.append(("nice", nice)))
    program.go_first()
    assert found == [taken]
