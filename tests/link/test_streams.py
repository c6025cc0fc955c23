"""Streams somebody wants: what is refused, and what the board is really asked for."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.link.session import budget
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.streams import Streams, check_rates
from mkdaemon.link.session.subscriptions import FASTEST, KINDS, SLOWEST_TIME, TICK_TIME, round_up_interval
from mkdaemon.protocol.messages import AttitudeRequest, OsdRequestV1
from mkdaemon.protocol.wire import Board

INTERVALS = st.floats(0.001, 3.0)
RULES = LineRules(direct=Board.NC)


def configured(**rates):
    return LinkConfig(port="/dev/x", rates=rates)


def demand_of(streams):
    return budget.Demand(streams, echo_hz=5.0)


@given(wish=INTERVALS)
def test_no_stream_is_asked_for_faster_than_wished(wish):
    real = round_up_interval(wish)
    assert FASTEST <= real <= SLOWEST_TIME + 1e-9
    assert real == pytest.approx(round(real / TICK_TIME) * TICK_TIME)
    assert real >= min(wish, SLOWEST_TIME) - 1e-7
    assert real < max(wish, FASTEST) + TICK_TIME


@given(board=st.sampled_from([Board.NC, Board.FC]), wishes=st.dictionaries(st.sampled_from(list(KINDS)), INTERVALS))
def test_whatever_is_wished_the_line_never_carries_more_than_its_share(board, wishes):
    rules = LineRules(direct=board)
    streams = Streams(LinkConfig(port="/dev/x", rates="off"))
    streams.use_board(board)
    for key, interval in wishes.items():
        before = streams.wanted
        try:
            streams.want(key, interval, rules, demand_of)
        except CommandRejectedError:
            assert streams.wanted == before
    assert budget.plan(demand_of(streams.wanted), rules).rx <= 0.85


def test_25_ms_of_osd_is_asked_for_as_30_ms():
    """Rounded down it was 20 ms: 103 % of the line."""
    streams = Streams(LinkConfig(port="/dev/x", rates="off"))
    streams.use_board(Board.NC)
    streams.want("osd", 0.025, LineRules(direct=Board.NC), demand_of)
    assert streams.wanted == {"osd": pytest.approx(0.03)}


def test_configured_rates_the_line_cannot_carry_are_refused_with_the_arithmetic():
    with pytest.raises(ConfigError, match=r"link.rates: O at 20 ms \+ D at 20 ms .* need 185 % of the line"):
        check_rates(configured(osd=20, debug=20))
    with pytest.raises(ConfigError, match="D at 20 ms"):  # 82 % from a NaviCtrl, 86 % from the slower FlightCtrl
        check_rates(configured(debug=20))
    for rates in ({"osd": 50, "debug": 50, "attitude": 50}, {"osd": 100, "attitude": 50, "debug": 200}, {}):
        check_rates(configured(**rates))


def test_a_configured_stream_that_does_not_exist_names_the_nearest():
    with pytest.raises(ConfigError, match="there is no stream 'ods'; did you mean osd"):
        check_rates(configured(ods=100))


@pytest.mark.parametrize("event", ["the port was opened again", "another board streams"])
def test_what_a_clients_own_request_started_ends_with_the_board_it_was_started_on(event):
    streams = Streams(LinkConfig(port="/dev/x", rates="off"))
    streams.use_board(Board.NC)
    streams.want("osd", 0.5, RULES, demand_of)
    for request in (OsdRequestV1(interval=10), AttitudeRequest(interval=10)):
        streams.request_received(request, Board.NC, 0.0, RULES, demand_of)
    assert streams.wanted == {"osd": pytest.approx(0.1), "attitude": pytest.approx(0.1)}
    if event == "the port was opened again":
        streams.restart()
    else:
        streams.use_board(Board.NC)
    assert streams.wanted == {"osd": pytest.approx(0.5)}


def test_a_clients_request_to_end_a_stream_touches_no_wish():
    streams = Streams(LinkConfig(port="/dev/x", rates="off"))
    streams.use_board(Board.NC)
    streams.want("osd", 0.5, RULES, demand_of)
    streams.request_received(OsdRequestV1(interval=0), Board.NC, 0.0, RULES, demand_of)
    assert streams.wanted == {"osd": pytest.approx(0.5)}
