"""Streams: what boards are asked for within the line's budget, when it is renewed, and what somebody wants."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.link.session import budget
from mkdaemon.link.session.budget import Demand, best_mix, check, plan
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.renewal import (
    ONCE_IN,
    SHORTEST,
    TIME_TO_LIVE,
    HeardShare,
    renewal_interval,
    time_between_ends,
)
from mkdaemon.link.session.streamkinds import KINDS, kind_of
from mkdaemon.link.session.streams import OVERDUE_PERIODS, Streams, Subscriptions, check_rates
from mkdaemon.protocol.messages import AttitudeRequest, OsdRequestV1
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


@pytest.fixture
def subscriptions():
    return Subscriptions(Board.NC, HeardShare())


def test_the_renewal_is_a_kind_nobody_wants_because_interval_0_costs_no_frame():
    subscriptions = Subscriptions(Board.NC, HeardShare(), renew=1.5)
    subscriptions.want("osd", 0.1)
    asked = requests_until(subscriptions, 10.0)
    assert asked[0][1] == OsdRequestV1(interval=10)
    assert {message for _, message in asked[1:]} == {AttitudeRequest(interval=0)}
    gaps = [b[0] - a[0] for a, b in itertools.pairwise(asked)]
    assert max(gaps) == pytest.approx(subscriptions.renewal, abs=0.011)
    assert min(gaps) == pytest.approx(subscriptions.renewal, abs=0.011)


def asked_for(key: str, interval: float, silent_for: float) -> list[float]:
    """When a stream is asked for that ran for a second and then fell silent; from its last frame on [s]."""
    subscriptions = Subscriptions(Board.FC, HeardShare())
    subscriptions.want(key, interval)
    requests_until(subscriptions, 1.0)
    ask, times, now = KINDS[key].ask(interval), [], 1.0
    while now < 1.0 + silent_for:
        times += [now - 0.99 for message in subscriptions.due(now) if message == ask]
        now += 0.001
    return times


@pytest.mark.parametrize("interval", [0.03, 0.05, 0.1])
def test_the_attitude_is_asked_for_after_three_periods_and_then_until_it_comes(interval):
    times = asked_for("attitude", interval, 5.0)
    assert times[0] == pytest.approx(OVERDUE_PERIODS * interval, abs=0.011)
    gaps = [after - before for before, after in itertools.pairwise(times)]
    assert len(times) > 25
    assert all(0.1 <= gap <= 0.2 for gap in gaps)


def test_a_stream_a_board_does_not_have_is_refused_with_those_it_has():
    with pytest.raises(CommandRejectedError) as caught:
        Subscriptions(Board.FC, HeardShare()).want("osd", 0.1)
    assert caught.value.token == "no_such_stream"
    assert "attitude" in caught.value.fix
    with pytest.raises(CommandRejectedError):
        kind_of("nonsense", Board.ANY)


def test_a_stream_is_ended_once_and_only_on_a_board_that_has_it(subscriptions):
    for _ in range(2):
        subscriptions.end("debug")
    assert len(subscriptions.due(0.0)) == 1
    assert subscriptions.due(1.0) == []
    subscriptions = Subscriptions(Board.FC, HeardShare())
    subscriptions.end("osd")
    assert subscriptions.due(0.0) == []


INTERVALS = st.floats(0.001, 3.0)
RULES = LineRules(direct=Board.NC)


def configured(**rates):
    return LinkConfig(port="/dev/x", rates=rates)


def demand_of(streams):
    return budget.Demand(streams, echo_hz=5.0)


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


NC = LineRules(direct=Board.NC)
FC = LineRules(direct=Board.FC)


def test_two_fast_streams_are_refused_with_the_arithmetic_and_the_advice_fits():
    wanted = {"osd": 0.02, "debug": 0.02}
    with pytest.raises(CommandRejectedError) as caught:
        check(Demand(wanted), NC, limit=0.85)
    assert caught.value.token == "line_budget"
    assert "O at 20 ms + D at 20 ms need 184 % of the line" in caught.value.reason
    assert "2.2 times longer" in caught.value.fix
    check(Demand({key: interval * 2.25 for key, interval in wanted.items()}, echo_hz=5), NC, limit=0.85)


def test_setpoints_that_do_not_fit_are_refused():
    with pytest.raises(CommandRejectedError, match="towards the board"):
        check(Demand({"attitude": 0.05}, echo_hz=5, setpoint_hz=130), FC, limit=0.85)


@pytest.mark.parametrize(
    ("demand", "rules", "rx"),
    [
        (Demand({"osd": 0.05, "debug": 0.05, "attitude": 0.05}), NC, 0.826),  # measured: 84 %
        (Demand({"debug": 0.1}), FC, 94 * 182e-6 / 0.1),  # slower than nominal
        (Demand({}, setpoint_hz=50, confirms=True), FC, 50 * 10 * 182e-6),
        (Demand({}, setpoint_hz=50, confirms=False), FC, 0.0),
    ],
)
def test_the_share_of_the_line_towards_us_is_as_measured(demand, rules, rx):
    assert plan(demand, rules).rx == pytest.approx(rx, abs=0.005)


@pytest.mark.parametrize(("board", "rules"), [(Board.NC, NC), (Board.FC, FC)])
@pytest.mark.parametrize("limit", [0.2, 0.5, 0.85])
def test_the_automatic_mix_fits_and_nothing_better_does(board, rules, limit):
    others = Demand({}, echo_hz=5, setpoint_hz=50, confirms=board is Board.FC)
    mix = best_mix(board, rules, limit=limit, demand=others)
    assert plan(Demand(mix, 5, 50, 18, board is Board.FC), rules).rx <= limit
    assert set(mix) == {key for key, kind in KINDS.items() if board in kind.boards and key != "display"}


FATES = st.lists(st.booleans(), max_size=400)


def share_of(fates) -> HeardShare:
    share = HeardShare()
    for is_answered in fates:
        share.note(is_answered=is_answered)
    return share


@given(fates=FATES, longest=st.floats(0.5, 2.0))
def test_streams_run_out_less_than_once_in_a_hundred_hours_or_renewals_come_as_often_as_they_may(fates, longest):
    share = share_of(fates)
    interval = renewal_interval(share, longest)
    assert SHORTEST <= interval <= longest
    assert time_between_ends(interval, share) >= ONCE_IN or interval == SHORTEST
    if interval < longest:  # no more often than needed
        fewer = int(TIME_TO_LIVE / interval + 1e-9) - 1
        rarer = min(TIME_TO_LIVE / fewer, longest)
        assert rarer == interval or time_between_ends(rarer, share) < ONCE_IN or interval == SHORTEST
