"""What the daemon knows about the vehicle, and how long it counts."""

from __future__ import annotations

from mkdaemon.control.vehicle import FRESH as MOTORS_AGE
from mkdaemon.control.vehicle import MOTOR_TEST as TEST_LASTS
from mkdaemon.daemon.vitals import PROOF_AGE, Vitals
from mkdaemon.protocol.wire import Board
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.link import LinkCondition, LinkState

STAMP = Stamp(monotonic=5.0, wall=6.0)


def vitals():
    return Vitals("")


def test_knowledge_about_the_motors_grows_old():
    known = vitals()
    assert known.motors_running(0.0) is None
    known.motors_said(True, 100.0)
    assert known.motors_running(100.0 + MOTORS_AGE) is True
    assert known.motors_running(100.0 + MOTORS_AGE + 0.01) is None


def test_a_motor_test_explains_turning_motors_for_a_while():
    known = vitals()
    assert not known.is_testing_motors(0.0)
    known.motor_test_sent(99.5)
    assert known.is_testing_motors(99.5 + TEST_LASTS)
    assert not known.is_testing_motors(99.5 + TEST_LASTS + 0.1)


def link_state(openings=1, redirected_to="", condition=LinkCondition.UP):
    return LinkState(
        condition=condition, reason="", since=STAMP, stamp=STAMP, port="x", baud=57600, hears_board=True,
        board_hears_us=True, openings=openings, redirected_to=redirected_to,
    )  # fmt: skip


def test_a_version_reply_proves_a_board_until_it_is_old_or_the_line_has_changed():
    known = vitals()
    known.link_said(link_state())
    assert not known.is_proven(Board.FC, 0.0)
    assert known.last_named() == "no board answered one"
    known.version_said(Board.FC, "2.12a", 10.0)
    assert known.is_proven(Board.FC, 10.0 + PROOF_AGE)
    assert not known.is_proven(Board.FC, 10.0 + PROOF_AGE + 0.01)
    assert not known.is_proven(Board.NC, 10.0)
    assert known.last_named() == "fc answered it"
    known.link_said(link_state(condition=LinkCondition.DEGRADED))
    assert known.is_proven(Board.FC, 10.0)
    known.link_said(link_state(redirected_to="fc"))
    assert not known.is_proven(Board.FC, 10.0)
    known.version_said(Board.FC, "2.12a", 11.0)
    known.link_said(link_state(openings=2, redirected_to="fc"))
    assert not known.is_proven(Board.FC, 11.0)


def test_vehicle_alive_is_not_daemon_alive():
    known = Vitals("a note")
    silent = known.health(STAMP, read_only="unknown firmware")
    assert (silent.is_alive, silent.link, silent.read_only) == (False, "absent", "unknown firmware")
    for condition, alive in ((LinkCondition.UP, True), (LinkCondition.ONE_WAY, True), (LinkCondition.MUTE, False)):
        known.link_said(link_state(condition=condition))
        assert known.health(STAMP, read_only=None).is_alive is alive
