"""The active release: neutral, then Config = 0 five times, confirmed where it can be."""

from __future__ import annotations

import math

import pytest

from mkdaemon.link.session.release import (
    CONFIRM_WAIT,
    EITHER,
    GIVE_UP,
    QUIET_TIME,
    REMIND,
    REPEATS,
    SPACING,
    ReleasePlan,
    neutral_of,
    shortest_release,
    zero_frame,
)
from mkdaemon.protocol.flags import ControlConfig
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2, ExternControlV3
from mkdaemon.protocol.wire import WireMessage
from mksim.boards.reception import FcReceiver

FLYING = ExternControlV2(pitch=20, roll=-20, yaw=10, throttle=40, frame=9, config=1)


def play(
    plan: ReleasePlan, *, confirm: float | None, lose: int = 0, end: float = 10.0
) -> list[tuple[float, WireMessage]]:
    """Send what is due; confirm each frame after `confirm` seconds, but for the first `lose`."""
    sent, answers, now, number = [], [], 0.0, 0
    while now < end and plan.is_running:
        for at, confirmed in [a for a in answers if a[0] <= now]:
            plan.confirmed(confirmed, at)
            answers.remove((at, confirmed))
        if (build := plan.due(now)) is not None:
            number += 1
            message = build(number)
            plan.sent(message, number)
            sent.append((now, message))
            if confirm is not None and number > lose:
                answers.append((now + confirm, number))
        now += 0.001
    return sent


def plan(
    *, confirms: bool, flying: WireMessage | None = FLYING, layout: type[WireMessage] | None = ExternControlV2
) -> ReleasePlan:
    return ReleasePlan(layout=layout, last_setpoint=flying, confirms=confirms, now=0.0, reason="test")


def test_lost_frames_are_repeated_until_five_are_confirmed():
    run = plan(confirms=True)
    sent = play(run, confirm=0.005, lose=4)
    assert run.result().status == "confirmed"
    assert len(sent) > 1 + REPEATS
    assert sent[2][0] - sent[1][0] >= CONFIRM_WAIT - 1e-9
    sent = play(plan(confirms=True, flying=None), confirm=0.005)
    assert all(int(message.config) == 0 for _, message in sent), "a neutral frame would engage without one before"


def test_while_the_layout_is_unknown_no_confirmation_counts():
    """A board confirms a frame in the form of another generation under a number that was never sent."""
    run = plan(confirms=True, flying=None, layout=None)
    play(run, confirm=0.005)
    result = run.result()
    assert (result.status, result.confirmed) == ("unconfirmed", 0)
    assert result.sent > REPEATS


@pytest.mark.parametrize("layout", EITHER)
@pytest.mark.parametrize("leftover", [0x00, 0x3D, 0x3E, 0x7C, 0xFF])
def test_no_frame_for_an_unknown_layout_sets_the_valid_bit_in_any_form(layout, leftover):
    """Read as whatever a FlightCtrl may take it for, with whatever an older frame has left in its buffer."""
    for number in range(256):
        receiver = FcReceiver(220)
        receiver.buffer.bytes[:] = bytes([leftover]) * len(receiver.buffer.bytes)
        assert [receiver.take(byte) for byte in zero_frame(layout, number).to_frame()][-1]
        receiver.buffer.decode_in_place()
        for form in (ExternControlV1, ExternControlV2, ExternControlV3):
            assert not form.decode(receiver.buffer.payload(form.spec.size)).config & ControlConfig.VALID


def test_2_12a_ignores_every_frame_for_an_unknown_layout():
    assert min(len(zero_frame(ExternControlV1, number).to_frame()) for number in range(256)) >= 20


def test_level_sticks_keep_their_throttle():
    level = neutral_of(FLYING, 7)
    assert (level.pitch, level.roll, level.yaw, level.throttle, level.frame) == (0, 0, 0, 40, 7)


def send(run: ReleasePlan, now: float, number: int) -> WireMessage | None:
    """Send what is due; None where nothing is."""
    build = run.due(now)
    if build is None:
        return None
    message = build(number)
    run.sent(message, number)
    return message


def test_a_plan_begins_at_once_and_follows_its_neutral_frame_without_a_pause():
    run = ReleasePlan(layout=ExternControlV2, last_setpoint=FLYING, confirms=True, now=5.0, reason="test")
    assert run.next_time() == 5.0
    assert run.due(4.999) is None
    first = send(run, 5.0, 1)
    assert (first.config, first.pitch, first.frame) == (1, 0, 1)
    assert run.next_time() == 5.0
    second = send(run, 5.0, 2)
    assert (second.config, second.frame) == (0, 2)
    assert run.next_time() == 5.0 + CONFIRM_WAIT
    assert run.due(5.0 + CONFIRM_WAIT - 1e-6) is None
    assert run.result() == run.result().__class__("unconfirmed", 1, 0, "test"), "the neutral frame ends nothing"


def test_each_confirmation_brings_the_next_frame_at_once_and_counts_once():
    run = plan(confirms=True, flying=None)
    for number in range(1, REPEATS + 1):
        now = number / 100
        assert send(run, now, number) is not None
        assert run.due(now + 0.001) is None
        run.confirmed(number, now + 0.005)
        run.confirmed(number, now + 0.006)
        assert run.result().confirmed == number
        assert run.is_running is (number < REPEATS)
        assert run.next_time() == (now + 0.005 if number < REPEATS else math.inf)
    assert run.result().status == "confirmed"
    assert run.due(99.0) is None


def test_a_strange_confirmation_and_that_of_the_neutral_frame_are_none_of_a_release():
    run = plan(confirms=True)
    run.confirmed(77, 0.0)
    assert run.result().status == "unconfirmed"
    send(run, 0.0, 1)
    run.confirmed(1, 0.005)
    assert run.result().confirmed == 0
    assert run.next_time() == 0.0


def test_a_late_confirmation_of_a_repeated_frame_counts_too():
    run = plan(confirms=True, flying=None)
    send(run, 0.0, 1)
    send(run, CONFIRM_WAIT, 2)
    for number in (1, 2):
        run.confirmed(number, CONFIRM_WAIT + 0.02)
    assert run.result().confirmed == 2


def test_it_gives_up_right_after_its_time_and_reminds_until_the_longest_dead_man_is_over():
    run = plan(confirms=True, flying=None)
    assert send(run, GIVE_UP, 1) is not None, "its time is not over yet"
    now = GIVE_UP + CONFIRM_WAIT
    assert send(run, now, 2) is None
    assert run.outcome == "unconfirmed"
    assert not run.is_running
    reminders = []
    while run.next_time() < math.inf:
        assert run.next_time() == pytest.approx(now + REMIND * (len(reminders) + 1))
        at = run.next_time()
        assert run.due(at - 1e-6) is None
        message = send(run, at, 3 + len(reminders))
        reminders += [at] if message is not None else []
        assert message is None or not message.config
    assert reminders[0] == now + REMIND
    assert len(reminders) == round(QUIET_TIME / REMIND), "the last one when the time is over, and no further one"
    assert reminders[-1] == pytest.approx(now + QUIET_TIME)
    assert run.result().sent == 1 + len(reminders)


def test_reminders_can_confirm_the_release_late():
    run = plan(confirms=True, flying=None)
    send(run, 0.0, 1)
    send(run, GIVE_UP + 0.1, 2)
    assert run.outcome == "unconfirmed"
    now = run.next_time()
    for number in range(3, 3 + REPEATS):
        assert send(run, now, number) is not None
        now += 0.005
        run.confirmed(number, now)
        assert run.next_time() == (now if number < 2 + REPEATS else math.inf)
    assert run.result().status == "confirmed"


V1, V2 = ExternControlV1, ExternControlV2


@pytest.mark.parametrize(("layout", "forms"), [(V2, [V2] * REPEATS), (None, [V1, V2] * REPEATS + [V1])])
def test_where_nothing_is_confirmed_it_ends_with_the_last_of_its_frames(layout, forms):
    """While the layout is unknown both forms go out in turn, the old one first and last."""
    run = plan(confirms=False, flying=None, layout=layout)
    for number, form in enumerate(forms, 1):
        assert run.is_running
        at = run.next_time()
        assert at == pytest.approx((number - 1) * SPACING)
        assert type(send(run, at, number)) is form
        assert run.result().sent == number
    assert run.outcome == "not_observable"
    assert run.next_time() == math.inf
    assert run.due(99.0) is None


@pytest.mark.parametrize("sent", range(1, REPEATS + 2))
def test_where_confirmations_end_it_sends_what_is_left_of_five_and_waits_for_none(sent):
    run = plan(confirms=True, flying=None)
    for number in range(sent):
        send(run, number * CONFIRM_WAIT, number + 1)
    run.expect_no_confirmation()
    assert not run.confirms
    now = sent * CONFIRM_WAIT
    while run.is_running:
        send(run, now, 50)
        now += SPACING
    assert run.result().status == "not_observable"
    assert run.result().sent == max(sent, REPEATS)


def test_the_shortest_release_is_one_frame_or_both_forms_all_of_them_zero():
    for layout in (ExternControlV1, ExternControlV2, ExternControlV3):
        assert shortest_release(layout) == [zero_frame(layout, 0)]
        assert (type(zero_frame(layout, 0)), any(zero_frame(layout, 0).encode())) == (layout, False)
    assert [type(frame) for frame in shortest_release(None)] == [V1, V2, V1]
    assert not any(any(frame.encode()) for frame in shortest_release(None))
