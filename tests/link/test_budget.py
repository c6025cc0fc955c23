"""The line's budget: shares, refusals with the arithmetic, the automatic mix."""

from __future__ import annotations

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.budget import Demand, best_mix, check, plan
from mkdaemon.link.session.line import LineRules
from mkdaemon.link.session.streamkinds import KINDS
from mkdaemon.protocol.messages import AttitudeDataNc, DebugDataNc, Display, OsdData5
from mkdaemon.protocol.wire import Board

NC = LineRules(direct=Board.NC)
FC = LineRules(direct=Board.FC)


def test_two_fast_streams_are_refused_with_the_arithmetic():
    with pytest.raises(CommandRejectedError) as caught:
        check(Demand({"osd": 0.02, "debug": 0.02}), NC, limit=0.85)
    assert caught.value.token == "line_budget"
    assert "O at 20 ms + D at 20 ms need 184 % of the line" in caught.value.reason
    assert "2.2 times longer" in caught.value.fix


def test_the_advice_fits():
    wanted = {"osd": 0.02, "debug": 0.02}
    with pytest.raises(CommandRejectedError):
        check(Demand(wanted, echo_hz=5), NC, limit=0.85)
    check(Demand({key: interval * 2.25 for key, interval in wanted.items()}, echo_hz=5), NC, limit=0.85)


def test_one_stream_is_singular_and_echoes_are_named():
    with pytest.raises(CommandRejectedError, match=r"O at 20 ms \+ echoes and confirmations \(9 %\) need 111 %"):
        check(Demand({"osd": 0.02}, echo_hz=50), NC, limit=0.85)
    with pytest.raises(CommandRejectedError, match="O at 20 ms needs 102 %"):
        check(Demand({"osd": 0.02}), NC, limit=0.85)


def test_setpoints_that_do_not_fit_are_refused():
    with pytest.raises(CommandRejectedError, match="towards the board"):
        check(Demand({"attitude": 0.05}, echo_hz=5, setpoint_hz=130), FC, limit=0.85)


def test_the_highest_measured_mix_is_84_percent():
    share = plan(Demand({"osd": 0.05, "debug": 0.05, "attitude": 0.05}), NC)
    assert share.rx == pytest.approx(0.826, abs=0.005)


def test_a_flightctrl_is_slower_than_nominal():
    assert plan(Demand({"debug": 0.1}), FC).rx == pytest.approx(94 * 182e-6 / 0.1)


def test_confirmations_count_towards_us():
    quiet, confirmed = (plan(Demand({}, setpoint_hz=50, confirms=c), FC).rx for c in (False, True))
    assert confirmed - quiet == pytest.approx(50 * 10 * 182e-6)


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


def test_declared_lengths_are_those_of_the_messages():
    for key, cls, size in (
        ("osd", OsdData5, 82),
        ("attitude", AttitudeDataNc, 14),
        ("debug", DebugDataNc, 66),
        ("display", Display, 80),
    ):
        assert cls.spec.size == size
        assert KINDS[key].characters == 6 + 4 * -(-size // 3)
