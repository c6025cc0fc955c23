"""The transmit scheduler: order, gaps, slots, deadlines, newest setpoint, quiet and deaf times."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.link.session.line import FC_GAP, FORWARDING_GAP, RESYNC, LineRules
from mkdaemon.link.session.scheduler import CATCH_UP, CREEP, RESYNC_AFTER, QueuedTransmission, TransmitScheduler
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.messages import AttitudeRequest, EchoRequest, ExternControlV2, LabelRequest
from mkdaemon.protocol.wire import Board

FC = LineRules(direct=Board.FC)
NC = LineRules(direct=Board.NC, setpoint_interval=FORWARDING_GAP)
NOBODY_YET = LineRules()


def entry(purpose: Purpose, *, board: Board = Board.FC, number: int = 1, **options: object) -> QueuedTransmission:
    message = {
        Purpose.RELEASE: ExternControlV2(pitch=0, roll=0, yaw=0, throttle=0, frame=number % 256),
        Purpose.SETPOINT: ExternControlV2(pitch=number % 100, roll=0, yaw=0, throttle=0, frame=number % 256),
        Purpose.SUBSCRIPTION: AttitudeRequest(interval=5),
        Purpose.ECHO: EchoRequest(pattern=number),
    }.get(purpose, LabelRequest(index=number % 32))
    deadline = options.pop("deadline", 1e9)
    return QueuedTransmission(message.to_frame(board), purpose, deadline, board, message, **options)  # type: ignore[arg-type]


def sent_until(scheduler: TransmitScheduler, end: float, *, now: float = 0.0) -> list[tuple[float, QueuedTransmission]]:
    """Ask as the link does: whenever the scheduler says."""
    out = []
    for _ in itertools.count():
        assert len(out) < 10_000
        while (taken := scheduler.take(now)) is not None:
            out.append((now, taken))
        at = scheduler.next_time(now)
        if at is None or at > end:
            return out
        now = max(at, now + 1e-6)
    raise AssertionError


@pytest.fixture
def scheduler():
    return TransmitScheduler(FC)


def test_order_is_release_setpoint_retry_request_subscription_echo_background(scheduler):
    for purpose in reversed(Purpose):
        scheduler.submit(entry(purpose), 0.0)
    assert [item.purpose for _, item in sent_until(scheduler, 1.0)] == list(Purpose)


def test_only_the_newest_setpoint_leaves(scheduler):
    scheduler.submit(entry(Purpose.REQUEST), 0.0)
    scheduler.take(0.0)
    for number in range(1, 6):
        scheduler.submit(entry(Purpose.SETPOINT, number=number), 0.001 * number)
    sent = sent_until(scheduler, 1.0, now=0.006)
    assert [item.message.frame for _, item in sent] == [5]
    assert [item.message.frame for item in scheduler.take_expired()] == [1, 2, 3, 4]


def test_what_is_past_its_deadline_never_leaves(scheduler):
    scheduler.submit(entry(Purpose.SETPOINT, deadline=0.05), 0.0)
    scheduler.submit(entry(Purpose.REQUEST, deadline=0.05), 0.0)
    assert scheduler.take(0.06) is None
    assert len(scheduler.take_expired()) == 2
    assert scheduler.take_expired() == []
    assert scheduler.next_time(0.06) is None


def test_one_request_of_a_kind_and_board_is_outstanding():
    scheduler = TransmitScheduler(NC)
    slot = (Board.NC, "A")
    for number in range(3):
        scheduler.submit(entry(Purpose.REQUEST, board=Board.NC, number=number, slot=slot, reply_within=0.3), 0.0)
    scheduler.submit(entry(Purpose.ECHO, board=Board.NC, slot=(Board.NC, "Z")), 0.0)
    sent = sent_until(scheduler, 0.2)
    assert [item.purpose for _, item in sent] == [Purpose.REQUEST, Purpose.ECHO]
    scheduler.reply_seen(Board.NC, "A")
    assert len(sent_until(scheduler, 0.2, now=0.15)) == 1
    # without a reply the slot frees itself after the time-out
    assert [at > 0.44 for at, _ in sent_until(scheduler, 1.0, now=0.2)] == [True]


def test_the_first_frame_and_the_one_after_an_error_or_silence_lead_with_two_returns(scheduler):
    raws = []
    for now in (0.0, 0.1, 0.2, 0.2 + RESYNC_AFTER + 0.1):
        scheduler.submit(entry(Purpose.REQUEST), now)
        taken = scheduler.take(now)
        assert taken is not None
        raws.append(taken.raw)
        if now == 0.1:
            scheduler.resynchronise()
    assert [raw.startswith(RESYNC + b"#") for raw in raws] == [True, False, True, True]


def test_a_deaf_board_gets_releases_only(scheduler):
    scheduler.deafen(Board.FC, 1.3)
    scheduler.deafen(Board.FC, 0.5)
    for purpose in (Purpose.REQUEST, Purpose.SETPOINT, Purpose.RELEASE):
        scheduler.submit(entry(purpose), 0.0)
    sent = sent_until(scheduler, 2.0)
    assert [item.purpose for _, item in sent] == [Purpose.RELEASE, Purpose.SETPOINT, Purpose.REQUEST]
    assert sent[1][0] >= 1.3


def test_quiet_keeps_back_what_would_refresh_the_dead_man(scheduler):
    scheduler.quieten("abdhlpt".__contains__, 6.0)
    label, attitude = entry(Purpose.REQUEST), entry(Purpose.SUBSCRIPTION)
    escape = QueuedTransmission(b"\x1b\x1b\x55\xaa\x00", Purpose.REQUEST, 1e9, Board.NC)
    for item in (label, attitude, escape, entry(Purpose.RELEASE)):
        scheduler.submit(item, 0.0)
    times = {item.purpose: at for at, item in sent_until(scheduler, 10.0) if item is not escape}
    assert times[Purpose.RELEASE] == 0.0
    assert times[Purpose.SUBSCRIPTION] < 0.1
    assert times[Purpose.REQUEST] >= 6.0


def test_quiet_does_not_touch_frames_a_navictrl_keeps_to_itself():
    scheduler = TransmitScheduler(NC)
    scheduler.quieten(lambda letter: True, 6.0)
    scheduler.submit(entry(Purpose.REQUEST, board=Board.NC), 0.0)
    scheduler.submit(entry(Purpose.SETPOINT, reaches_fc=True), 0.0)
    sent = sent_until(scheduler, 10.0)
    assert [(item.purpose, at >= 6.0) for at, item in sent] == [(Purpose.REQUEST, False), (Purpose.SETPOINT, True)]


def test_while_redirected_only_that_board_is_spoken_to():
    scheduler = TransmitScheduler(NC)
    scheduler.reserve_line(Board.FC)
    here = entry(Purpose.REQUEST, board=Board.FC, reaches_fc=True)
    there = entry(Purpose.REQUEST, board=Board.NC)
    escape = QueuedTransmission(b"\x1b\x1b\x55\xaa\x00", Purpose.REQUEST, 1e9, Board.NC)
    for item in (there, here, escape):
        scheduler.submit(item, 0.0)
    assert [item for _, item in sent_until(scheduler, 1.0)] == [here, escape]
    scheduler.reserve_line(None)
    assert scheduler.take(1.1) is there


def flown(
    period: float, distance: float, asks: list[float], seconds: float = 2.0
) -> list[tuple[float, QueuedTransmission]]:
    """What leaves while setpoints come steadily to a FlightCtrl and requests come at some times."""
    scheduler = TransmitScheduler(LineRules(direct=Board.FC, setpoint_interval=1 / 44))
    scheduler.distance = distance
    events = sorted(
        [(step * period, Purpose.SETPOINT) for step in range(int(seconds / period))]
        + [(at, Purpose.REQUEST) for at in asks]
    )
    sent, later = [], [at for at, _ in events[1:]] + [seconds + 1.0]
    for number, ((now, purpose), until) in enumerate(zip(events, later, strict=True)):
        scheduler.submit(entry(purpose, number=number, deadline=now + 1.0), now)
        sent += sent_until(scheduler, max(now, until - 1e-6), now=now)
    return sent


FLIGHTS = st.tuples(
    st.sampled_from([1 / 60, 0.02, 1 / 44, 0.025, 1 / 15]),
    st.sampled_from([0.0, 0.03, 0.04]),
    st.lists(st.floats(0.1, 1.9), max_size=12),
)


@given(flight=FLIGHTS)
def test_in_flight_requests_keep_their_distance_and_setpoints_their_rate(flight):
    period, distance, asks = flight
    sent = flown(period, distance, asks)
    assert sum(item.purpose is Purpose.REQUEST for _, item in sent) == len(asks)
    for (at, item), (later, following) in itertools.pairwise(sent):
        idle = later - at - FC.wire_time(item.raw)
        needed = max(FC_GAP, distance) if following.purpose is Purpose.REQUEST else FC_GAP
        assert idle >= needed - 1e-9
    setpoints = [at for at, item in sent if item.purpose is Purpose.SETPOINT]
    assert all(b - a >= FC_GAP for a, b in itertools.pairwise(setpoints))
    in_a_second = max(sum(begin <= at < begin + 1.0 for at in setpoints) for begin in setpoints)
    assert in_a_second <= 44 / CREEP + CATCH_UP + 1


@pytest.mark.parametrize(
    ("period", "distance", "replaced"), [(1 / 44, 0.0, 0), (1 / 44, 0.035, 1), (0.02, 0.0, 1), (0.02, 0.035, 2)]
)
def test_a_setpoint_waits_for_a_request_unless_that_held_up_the_next_one(period, distance, replaced):
    asks = [0.5, 0.753, 1.101, 1.417]
    alone, beside = flown(period, distance, []), flown(period, distance, asks)
    waits = [at - item.queued for at, item in beside if item.purpose is Purpose.SETPOINT]
    alone_waits = [at - item.queued for at, item in alone]
    assert len(alone_waits) - len(waits) <= replaced * len(asks)
    assert max(waits) <= max(alone_waits) + 0.0085
    asked = [at - item.queued for at, item in beside if item.purpose is Purpose.REQUEST]
    assert max(asked) <= max(FC_GAP, distance) + 0.005


@given(
    steps=st.lists(
        st.tuples(st.sampled_from(Purpose), st.floats(0.0, 0.05), st.sampled_from([Board.FC, Board.NC])), max_size=60
    ),
    rules=st.sampled_from([FC, NC, NOBODY_YET]),
)
def test_whatever_is_asked_the_line_and_the_boards_can_take_it(steps, rules):
    scheduler = TransmitScheduler(rules)
    now, sent = 0.0, []
    for purpose, pause, board in steps:
        now += pause
        steers = purpose in (Purpose.RELEASE, Purpose.SETPOINT)
        item = entry(purpose, board=Board.FC if steers else board, reaches_fc=steers, deadline=now + 1.0)
        scheduler.submit(item, now)
        sent += sent_until(scheduler, now + pause, now=now)
    sent += sent_until(scheduler, now + 2.0, now=now)
    assert scheduler.next_time(now + 3.0) is None
    for (at, item), (later, _) in itertools.pairwise(sent):
        idle = later - at - rules.wire_time(item.raw)
        assert idle >= -1e-9
        if rules.direct is not Board.NC:
            assert idle >= FC_GAP - 1e-9
    setpoints = [at for at, item in sent if item.purpose is Purpose.SETPOINT]
    nearest = rules.setpoint_interval * (1.0 if rules is NC else 1.0 - CATCH_UP)
    assert all(b - a >= nearest - 1e-9 for a, b in itertools.pairwise(setpoints))
    average = rules.setpoint_interval * (1.0 if rules is NC else CREEP)
    assert all(at - setpoints[0] >= (n - CATCH_UP) * average - 1e-9 for n, at in enumerate(setpoints))
