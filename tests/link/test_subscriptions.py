"""Subscriptions: one renewal a board, without a frame where possible; rates change at run time."""

from __future__ import annotations

import itertools
import math

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.subscriptions import ASK_AGAIN, KINDS, Subscriptions, kind_of
from mkdaemon.protocol.messages import AttitudeRequest, DebugRequest, OsdRequestV1
from mkdaemon.protocol.wire import Board


def flow(subscriptions: Subscriptions, now: float) -> None:
    for key in subscriptions.wanted:
        subscriptions.frame_received(key, now)


def requests_until(subscriptions: Subscriptions, end: float, now: float = 0.0) -> list[tuple[float, object]]:
    out = []
    while now < end:
        flow(subscriptions, now)
        out += [(now, message) for message in subscriptions.due(now)]
        now += 0.01
    return out


def test_wanted_streams_are_asked_for_at_once_and_once():
    subscriptions = Subscriptions(Board.NC)
    subscriptions.want("osd", 0.1)
    subscriptions.want("debug", 0.2)
    assert subscriptions.next_time() == -math.inf
    assert subscriptions.due(0.0) == [OsdRequestV1(interval=10), DebugRequest(interval=20)]
    assert subscriptions.due(0.01) == []


def test_the_renewal_is_a_kind_nobody_wants_because_interval_0_costs_no_frame():
    subscriptions = Subscriptions(Board.NC, renew=1.5)
    subscriptions.want("osd", 0.1)
    asked = requests_until(subscriptions, 10.0)
    assert asked[0][1] == OsdRequestV1(interval=10)
    assert [message for _, message in asked[1:]] == [AttitudeRequest(interval=0)] * 6
    gaps = [b[0] - a[0] for a, b in itertools.pairwise(asked)]
    assert max(gaps) < 2.0


def test_where_all_are_wanted_the_shortest_frame_renews():
    subscriptions = Subscriptions(Board.NC)
    for key in ("osd", "debug", "attitude"):
        subscriptions.want(key, 0.1)
    asked = requests_until(subscriptions, 4.0)
    assert [message for _, message in asked[3:]] == [AttitudeRequest(interval=10)] * 2


def test_a_display_request_is_no_renewal_because_it_answers_at_once():
    subscriptions = Subscriptions(Board.FC)
    subscriptions.want("attitude", 0.1)
    subscriptions.want("debug", 0.1)
    assert all(message.spec.id != "h" for _, message in requests_until(subscriptions, 5.0))


def test_only_a_changed_rate_is_asked_for_again():
    subscriptions = Subscriptions(Board.NC)
    subscriptions.want("osd", 0.1)
    subscriptions.want("debug", 0.1)
    subscriptions.due(0.0)
    subscriptions.want("osd", 0.1)
    assert subscriptions.due(0.1) == []
    subscriptions.want("osd", 0.2)
    assert subscriptions.due(0.2) == [OsdRequestV1(interval=20)]


def test_ending_a_stream_stops_it_and_keeps_the_others():
    subscriptions = Subscriptions(Board.NC)
    subscriptions.want("osd", 0.1)
    subscriptions.want("debug", 0.1)
    subscriptions.due(0.0)
    subscriptions.want("osd", 0)
    subscriptions.want("display", 0)
    assert subscriptions.next_time() == -math.inf
    assert subscriptions.due(0.1) == [OsdRequestV1(interval=0)]
    assert subscriptions.wanted == {"debug": 0.1}


def test_without_wishes_nothing_is_sent():
    subscriptions = Subscriptions(Board.NC)
    assert subscriptions.next_time() == math.inf
    assert subscriptions.due(100.0) == []


def test_a_stream_that_does_not_come_is_asked_for_again():
    subscriptions = Subscriptions(Board.NC)
    subscriptions.want("osd", 0.1)
    subscriptions.due(0.0)
    assert OsdRequestV1(interval=10) in subscriptions.due(ASK_AGAIN)
    subscriptions.frame_received("osd", 2.0)
    subscriptions.frame_received("attitude", 2.0)
    assert OsdRequestV1(interval=10) not in subscriptions.due(2.5)


def test_after_a_reboot_everything_is_asked_for_again():
    subscriptions = Subscriptions(Board.NC)
    subscriptions.want("osd", 0.1)
    requests_until(subscriptions, 3.0)
    subscriptions.forget()
    assert subscriptions.due(3.0) == [OsdRequestV1(interval=10)]


@pytest.mark.parametrize(
    ("wish", "ticks"), [(0.001, 2), (0.02, 2), (0.025, 3), (0.1, 10), (0.1049, 11), (0.29, 29), (9.0, 255)]
)
def test_intervals_are_what_the_board_can_count(wish, ticks):
    subscriptions = Subscriptions(Board.NC)
    subscriptions.want("osd", wish)
    assert subscriptions.due(0.0) == [OsdRequestV1(interval=ticks)]


def test_a_stream_a_board_does_not_have_is_refused_with_those_it_has():
    with pytest.raises(CommandRejectedError) as caught:
        Subscriptions(Board.FC).want("osd", 0.1)
    assert caught.value.token == "no_such_stream"
    assert "attitude" in caught.value.fix
    with pytest.raises(CommandRejectedError):
        kind_of("nonsense", Board.ANY)


def test_lengths_are_those_of_the_frames():
    for kind in KINDS.values():
        for board in kind.boards:
            assert kind.ask(0.1).to_frame(board).startswith(b"#")


def test_a_stream_is_ended_once_and_only_on_a_board_that_has_it():
    subscriptions = Subscriptions(Board.NC)
    for _ in range(2):
        subscriptions.end("debug")
    assert len(subscriptions.due(0.0)) == 1
    assert subscriptions.due(1.0) == []
    subscriptions = Subscriptions(Board.FC)
    subscriptions.end("osd")
    assert subscriptions.due(0.0) == []
