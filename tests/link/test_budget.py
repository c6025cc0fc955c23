"""The line's budget: shares, refusals with the arithmetic, the automatic mix."""

from __future__ import annotations

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.budget import Demand, best_mix, check, plan
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.streamkinds import KINDS
from mkdaemon.protocol.wire import Board

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


def test_one_stream_is_singular_and_echoes_are_named():
    with pytest.raises(CommandRejectedError, match=r"O at 20 ms \+ echoes and confirmations \(9 %\) need 111 %"):
        check(Demand({"osd": 0.02}, echo_hz=50), NC, limit=0.85)
    with pytest.raises(CommandRejectedError, match="O at 20 ms needs 102 %"):
        check(Demand({"osd": 0.02}), NC, limit=0.85)


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


def test_the_automatic_mix_lets_every_frame_through():
    """A stream faster than all kinds together take would be overtaken by its own next frame."""
    mix = best_mix(Board.NC, NC, limit=0.85)
    assert min(mix.values()) >= NC.reply_time(118 + 94 + 26)
    assert mix["attitude"] <= mix["osd"] <= mix["debug"]
