"""The active release: neutral, then Config = 0 five times, confirmed where it can be."""

from __future__ import annotations

import itertools

import pytest

from mkdaemon.link.session.release import CONFIRM_WAIT, GIVE_UP, REPEATS, SPACING, ReleasePlan, neutral_of, zero_frame
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2, ExternControlV3
from mkdaemon.protocol.wire import WireMessage

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
            plan.sent(message, number, now)
            sent.append((now, message))
            if confirm is not None and number > lose:
                answers.append((now + confirm, number))
        now += 0.001
    return sent


def plan(
    *, confirms: bool, flying: WireMessage | None = FLYING, layout: type[WireMessage] | None = ExternControlV2
) -> ReleasePlan:
    return ReleasePlan(layout=layout, last_setpoint=flying, confirms=confirms, now=0.0, reason="test")


def test_neutral_first_then_five_confirmed_zeros():
    run = plan(confirms=True)
    sent = play(run, confirm=0.005)
    first, *rest = [message for _, message in sent]
    assert (first.pitch, first.roll, first.yaw, first.throttle, int(first.config)) == (0, 0, 0, 40, 1)
    assert len(rest) == REPEATS
    assert all(int(message.config) == 0 and message.pitch == 0 for message in rest)
    result = run.result()
    assert (result.status, result.sent, result.confirmed) == ("confirmed", REPEATS, REPEATS)
    assert sent[-1][0] < 0.1


def test_without_a_command_before_there_is_no_neutral_frame_because_it_would_engage():
    sent = play(plan(confirms=True, flying=None), confirm=0.005)
    assert all(int(message.config) == 0 for _, message in sent)


def test_where_no_confirmation_can_come_five_are_sent_in_the_pace_a_navictrl_passes_on():
    run = plan(confirms=False)
    sent = play(run, confirm=None)
    zeros = [at for at, message in sent if not message.config]
    assert len(zeros) == REPEATS
    assert min(b - a for a, b in itertools.pairwise(zeros)) >= SPACING - 1e-9
    assert run.result().status == "not_observable"


def test_lost_frames_are_repeated_until_five_are_confirmed():
    run = plan(confirms=True)
    sent = play(run, confirm=0.005, lose=4)
    assert run.result().status == "confirmed"
    assert len(sent) > 1 + REPEATS
    assert sent[2][0] - sent[1][0] >= CONFIRM_WAIT - 1e-9


def test_it_gives_up_and_says_so():
    run = plan(confirms=True)
    sent = play(run, confirm=None)
    result = run.result()
    assert (result.status, result.confirmed) == ("unconfirmed", 0)
    assert result.sent >= 20
    assert GIVE_UP <= sent[-1][0] + CONFIRM_WAIT <= GIVE_UP + 2 * CONFIRM_WAIT
    assert run.due(99.0) is None
    assert run.next_time() == float("inf")


def test_a_strange_confirmation_changes_nothing():
    run = plan(confirms=True)
    run.confirmed(77, 0.0)
    assert run.result().confirmed == 0
    assert run.result().status == "unconfirmed"


@pytest.mark.parametrize("layout", [ExternControlV1, ExternControlV2, ExternControlV3, None])
def test_the_release_frame_of_every_layout_is_all_zero(layout):
    frame = zero_frame(layout, 0)
    assert not any(frame.encode())
    assert type(frame) is (layout or ExternControlV1)


def test_the_frame_for_an_unknown_release_cannot_set_the_valid_bit_anywhere():
    """Read as any layout, at any length a FlightCtrl may take, Config is zero."""
    raw = zero_frame(None, 255).encode()
    assert len(raw) == 11
    assert len(zero_frame(None, 1).to_frame()) == 22  # 16 payload characters: 2.12a ignores 20 and more in all
    for cls in (ExternControlV2, ExternControlV3):
        assert int(cls.decode(raw).config) == 0
    assert int(ExternControlV1.decode(raw).config) == 0


def test_level_sticks_keep_their_throttle():
    level = neutral_of(FLYING, 7)
    assert (level.pitch, level.roll, level.yaw, level.throttle, level.frame) == (0, 0, 0, 40, 7)
