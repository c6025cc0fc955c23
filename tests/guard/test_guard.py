"""What the guard owes the aircraft, as lists of events; the process itself is tested in test_process.py."""

from __future__ import annotations

import itertools
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon import guard as program
from mkdaemon.guard import FRAME_SPACING, NEUTRAL_AFTER, RELEASE_AFTER, RELEASE_FRAMES, RESYNC, Guard, Word, beat

OLD, NEW, NEUTRAL = b"#old\r", b"#new\r", b"#neutral\r"
FRAMES = Word.FRAMES + json.dumps([OLD.hex(), NEW.hex()]).encode()
STEP = 0.005


def fly(until, since=0.0, period=0.02):
    """Heartbeats, each heard when the stick frame was written."""
    count = int((until - since) / period + 0.5)
    return [(since + k * period, beat(NEUTRAL, since + k * period)) for k in range(count + 1)]


def run(events, until, step=STEP):
    """Everything a guard writes, with its time, for packets at their times; it looks every `step`."""
    guard, written, now, left = Guard(), [], 0.0, sorted(events, key=lambda event: event[0])
    while now <= until:
        while left and left[0][0] <= now:
            guard.hear(left.pop(0)[1], now)
        frames = guard.due(now)
        if frames:
            written.append((now, b"".join(frames)))
        now = round(now + step, 9)
    return guard, written


def levels(written):
    """When neutral sticks were written."""
    return [at for at, data in written if NEUTRAL in data]


def releases(written):
    """When release frames were written."""
    return [at for at, data in written if data in {OLD, NEW}]


@pytest.mark.parametrize(
    ("events", "written", "is_armed", "is_over"),
    [
        ([(0, FRAMES), *fly(3.0)], [], True, False),
        ([(0, FRAMES)], [], False, False),
        ([(0, FRAMES), (1.0, b"")], [], False, True),
        ([(0, FRAMES), *fly(0.5), (0.51, Word.SAFE), (0.52, b"")], [], False, True),
        ([*fly(0.5), (0.6, b"")], [(0.6, RESYNC + NEUTRAL)], True, True),
    ],
    ids=["regular beats", "never armed", "never armed, and it ends", "nothing is owed", "no release frames are known"],
)
def test_where_no_release_is_owed_none_is_sent(events, written, is_armed, is_over):
    guard, sent = run(events, 3.0)
    assert sent == [(pytest.approx(at, abs=STEP), data) for at, data in written]
    assert (guard.is_armed, guard.is_over, guard.release_sent) == (is_armed, is_over, 0)


def test_silence_is_neutral_at_its_time_again_and_again_and_then_released():
    guard, written = run([(0, FRAMES), *fly(1.0)], 5.0, step=0.001)
    assert levels(written) == pytest.approx([1.25, 1.35, 1.45, 1.55, 1.65, 1.75], abs=0.01)
    assert [data for _, data in written[:2]] == [RESYNC + NEUTRAL, NEUTRAL]
    assert releases(written)[0] == pytest.approx(1.8, abs=2 * STEP)
    assert guard.is_releasing
    assert guard.is_armed
    assert not guard.is_over, "the daemon may only be frozen"
    assert (guard.neutral_sent, guard.release_sent) == (6, RELEASE_FRAMES)


def test_release_frames_of_all_layouts_take_turns_and_have_an_end():
    guard, written = run([(0, FRAMES), *fly(0.1)], 9.0)
    sent = [data for _, data in written if NEUTRAL not in data]
    assert sent == [OLD, NEW] * (RELEASE_FRAMES // 2)
    gaps = [b - a for a, b in itertools.pairwise(releases(written))]
    assert min(gaps) >= FRAME_SPACING - 1e-9
    assert max(gaps) <= FRAME_SPACING + STEP
    assert guard.next_time() == float("inf")


def test_three_release_frames_take_turns_in_their_order():
    frames = [b"#1\r", b"#2\r", b"#3\r"]
    events = [(0, Word.FRAMES + json.dumps([frame.hex() for frame in frames]).encode()), *fly(0.1), (0.2, b"")]
    _, written = run(events, 3.0)
    assert [data for _, data in written[1:7]] == frames * 2


@pytest.mark.parametrize(
    ("left", "milliseconds"),
    [(float("inf"), None), (-5.0, 0), (0.0, 0), (1e-6, 1), (0.001, 1), (0.0011, 2), (0.25, 250), (2.0, 2000)],
)
def test_it_waits_until_something_is_due_and_never_less(left, milliseconds):
    assert program.poll_timeout(left) == milliseconds


def test_a_dead_daemon_is_released_at_once_neutral_first():
    guard, written = run([(0, FRAMES), *fly(1.0), (1.005, b"")], 5.0)
    assert written[0] == (pytest.approx(1.0 + FRAME_SPACING, abs=STEP), RESYNC + NEUTRAL), "not right behind a frame"
    assert written[1] == (pytest.approx(1.0 + 2 * FRAME_SPACING, abs=STEP), OLD)
    assert len(levels(written)) == 1
    assert len(releases(written)) == RELEASE_FRAMES
    assert guard.is_over


@pytest.mark.parametrize("dies", [1.255, 1.3, 1.6, 1.79, 1.9, 2.5, 4.0, 4.9])
def test_a_daemon_that_dies_after_its_silence_was_answered_is_released_at_once_and_only_once(dies):
    guard, written = run([(0, FRAMES), *fly(1.0), (dies, b"")], 5.0)
    assert releases(written)[0] <= min(dies + FRAME_SPACING, 1.0 + RELEASE_AFTER) + 2 * STEP
    assert dies > 1.8 or dies <= releases(written)[0]
    assert releases(written)[0] - max(levels(written)) >= FRAME_SPACING - 1e-9
    assert len(releases(written)) == RELEASE_FRAMES
    assert guard.is_over


@pytest.mark.parametrize("dies", [True, False])
@pytest.mark.parametrize("late", [0.0, 0.2, 0.5, 0.79, 0.8, 0.81, 1.0, 3.0, 60.0])
def test_however_late_the_guard_wakes_neutral_goes_before_the_release(late, dies):
    """It got no processor since the last stick frame; what it hears then it hears all at once."""
    guard = Guard()
    guard.hear(FRAMES, 0.0)
    guard.hear(beat(NEUTRAL, 1.0), 1.0)
    now = 1.0 + NEUTRAL_AFTER + late
    if dies:
        guard.hear(b"", now)
    assert guard.next_time() <= now
    assert guard.due(now) == (RESYNC, NEUTRAL)
    assert not guard.is_releasing
    assert guard.due(now + FRAME_SPACING - 0.001) == ()
    is_owed = dies or now + FRAME_SPACING >= 1.0 + RELEASE_AFTER
    assert guard.due(now + FRAME_SPACING) == ((OLD,) if is_owed else ())
    assert guard.is_releasing is is_owed


@given(st.lists(st.floats(0.0, 2.0), min_size=60, max_size=60), st.booleans())
def test_whenever_the_guard_gets_a_turn_it_sends_neutral_first_and_the_whole_release(delays, dies):
    guard, now, sent = Guard(), 0.0, []
    guard.hear(FRAMES, now)
    guard.hear(beat(NEUTRAL, now), now)
    if dies:
        guard.hear(b"", now)
    for delay in delays:
        if guard.next_time() == float("inf"):
            break
        now = max(now, guard.next_time()) + delay
        sent += [(now, frame) for frame in guard.due(now) if frame != RESYNC]
    frames = [frame for _, frame in sent]
    count = frames.count(NEUTRAL)
    assert count >= 1
    assert frames == [NEUTRAL] * count + [OLD, NEW] * (RELEASE_FRAMES // 2)
    assert all(later - at >= FRAME_SPACING - 1e-9 for (at, _), (later, _) in itertools.pairwise(sent))
    assert guard.is_over is dies


def test_a_beat_counts_from_when_it_was_written_and_never_from_the_future():
    guard = Guard()
    guard.hear(FRAMES, 0.0)
    guard.hear(beat(NEUTRAL, 1.0), 1.2)
    assert guard.next_time() == 1.0 + NEUTRAL_AFTER
    guard.hear(beat(NEUTRAL, 9.0), 1.3)
    assert guard.next_time() == 1.3 + NEUTRAL_AFTER


def test_a_beat_without_a_neutral_frame_is_no_beat():
    guard = Guard()
    guard.hear(beat(b"", 1.0), 1.0)
    guard.hear(Word.BEAT + b"short", 1.0)
    assert not guard.is_armed


def test_a_short_stall_ends_with_the_next_beat_and_the_next_one_is_answered_anew():
    events = [(0, FRAMES), *fly(1.0), (1.5, beat(NEUTRAL, 1.5)), *fly(2.5, since=2.0), (2.7, Word.SAFE)]
    guard, written = run(events, 5.0)
    first, *_ = fresh = [at for at, data in written if data == RESYNC + NEUTRAL]
    assert first == pytest.approx(1.25, abs=2 * STEP)
    assert fresh[1] == pytest.approx(1.75, abs=2 * STEP)
    assert len(fresh) == 2
    assert releases(written) == []
    assert not guard.is_armed
    assert not guard.is_over


def test_beats_do_not_stop_a_release_that_has_begun():
    guard, written = run([(0, FRAMES), *fly(0.5), *fly(2.4, since=1.4)], 5.0)
    assert len(releases(written)) == RELEASE_FRAMES
    assert max(levels(written)) < min(releases(written))
    assert guard.is_releasing


def test_after_safe_nothing_is_sent_and_a_new_flight_is_watched_again():
    events = [(0, FRAMES), *fly(0.5), (1.5, Word.SAFE), (4.0, beat(NEUTRAL, 4.0))]
    guard, written = run(events, 6.5)
    assert [at for at, _ in written if 1.5 <= at < 4.0] == []
    again = [entry for entry in written if entry[0] > 4.0]
    assert again[0] == (pytest.approx(4.25, abs=2 * STEP), RESYNC + NEUTRAL)
    assert len(releases(again)) == RELEASE_FRAMES
    assert guard.is_releasing


@given(
    st.lists(
        st.tuples(
            st.floats(0, 5),
            st.sampled_from([beat(NEUTRAL, 0.0), Word.SAFE, FRAMES, Word.PING, Word.CLOSED, b"?x", b"H", b""]),
        ),
        max_size=40,
    )
)
def test_any_order_of_packets_sends_only_the_frames_it_was_given(events):
    _, written = run([(0, FRAMES), *events], 8.0, step=0.02)
    assert {data for _, data in written} <= {OLD, NEW, NEUTRAL, RESYNC + NEUTRAL}
    if not any(packet[:1] == Word.BEAT and len(packet) > 1 for _, packet in events):
        assert written == []


@pytest.mark.parametrize(("granted", "taken"), [(2, ("rr", 2)), (1, ("rr", 1)), (0, ("nice", 0, -10))])
def test_it_takes_the_best_priority_that_the_system_grants(monkeypatch, granted, taken):
    found = []

    def schedule(process, policy, parameters):
        if parameters.sched_priority > granted:
            raise PermissionError
        found.append(("rr", parameters.sched_priority))

    monkeypatch.setattr(program.os, "sched_setscheduler", schedule)
    monkeypatch.setattr(program.os, "setpriority", lambda which, process, nice: found.append(("nice", process, nice)))
    program.go_first()
    assert found == [taken]
