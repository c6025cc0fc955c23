"""Parts of the estimator: which cameras have a say, which stick frame acts when, and where it all leads."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.control.estimator.cameras import AGREED, AT_ONCE, TOGETHER, Cameras
from mkdaemon.control.estimator.commands import KNOWN, NEUTRAL, CommandHistory, StickFrame
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.values import StickCommand, TargetView
from tests.control.estimator.test_values import turned

HOVER = 125.0


def level_view(at=0.0, *, place=(0.0, 0.0, 2.0), yaw=0.0, covariance=None):
    """What a level aircraft sees."""
    r = turned((0.0, 0.0, yaw))
    return TargetView(at, -r.T @ np.array(place), r, np.diag([1e-6] * 6) if covariance is None else covariance)


def refused(cameras, name, at, times=3):
    cameras.seen(name, at)
    for _ in range(times):
        cameras.judged(name, is_refused=True)


def test_cameras_share_an_attitude_while_their_newest_images_are_close():
    cameras = Cameras(3)
    assert cameras.seen("down", 0.0) == 1
    assert cameras.seen("forward", AT_ONCE) == 2
    assert cameras.seen("down", 2.0 * AT_ONCE + 0.01) == 1
    assert cameras.seen("forward", AT_ONCE) == 1, "an image that comes late makes no camera older"
    assert cameras.seen("forward", 2.0 * AT_ONCE) == 2


def judge(cameras, at, **refused):
    """One image of a camera, and one pose of a source, at a time [s]."""
    for name, is_refused in refused.items():
        cameras.seen(name, at, is_placed=name != "down")
        cameras.judged(name, is_refused=is_refused)


def test_a_source_outvotes_no_camera_and_has_to_agree_for_long():
    cameras = Cameras(3)
    assert not cameras.uses("mocap")
    for k in range(100):
        judge(cameras, 0.03 * k, mocap=False, down=False)
    assert cameras.uses("mocap")
    for k in range(100, 103):
        judge(cameras, 0.03 * k, mocap=False, down=True)
    assert cameras.contradicting == ("mocap",)
    assert cameras.doubts("down", 3.06)
    assert not cameras.uses("mocap")
    for k in range(103, 102 + AGREED):
        judge(cameras, 0.03 * k, mocap=False, down=False)
    assert cameras.contradicting == ("mocap",)
    judge(cameras, 0.03 * (102 + AGREED), mocap=False, down=False)
    assert cameras.contradicting == ()
    assert cameras.uses("mocap")
    cameras.seen("down", 0.03 * (102 + AGREED) + TOGETHER + 0.01)
    assert not cameras.uses("mocap")


def test_a_source_that_comes_after_a_camera_is_only_compared_until_it_has_agreed_for_long():
    cameras = Cameras(3)
    judge(cameras, 0.0, down=False)
    for k in range(1, AGREED):
        judge(cameras, 0.03 * k, down=False, mocap=False)
    assert cameras.is_on_trial("mocap")
    assert not cameras.uses("mocap")
    judge(cameras, 0.03 * AGREED, down=False, mocap=False)
    assert not cameras.is_on_trial("mocap")
    assert cameras.uses("mocap")


def test_a_source_on_trial_is_used_when_the_camera_falls_silent():
    cameras = Cameras(3)
    judge(cameras, 0.0, down=False)
    judge(cameras, 0.03, mocap=False)
    assert cameras.is_on_trial("mocap")
    cameras.seen("mocap", TOGETHER + 0.01, is_placed=True)
    assert not cameras.is_on_trial("mocap")


def test_a_source_that_a_camera_contradicts_is_left_out_and_the_camera_is_not_doubted():
    cameras = Cameras(3)
    for k in range(3):
        judge(cameras, 0.03 * k, mocap=True, down=False)
    assert cameras.contradicting == ("mocap",)
    assert not cameras.doubts("mocap", 0.06)
    assert not cameras.doubts("down", 0.06)


def test_of_two_sources_either_can_be_left_out():
    cameras = Cameras(3)
    for k in range(3):
        judge(cameras, 0.03 * k, mocap=False, uwb=True)
    assert cameras.contradicting == ("uwb",)


def test_a_camera_that_is_silent_contradicts_nobody():
    cameras = Cameras(3)
    refused(cameras, "down", 0.0)
    for at in (0.0, TOGETHER):
        cameras.seen("forward", at)
        assert cameras.contradicting == ("down",)
    cameras.seen("forward", TOGETHER + 0.01)
    assert cameras.contradicting == ()


def test_a_majority_contradicts_and_where_all_do_the_estimate_is_wrong():
    cameras = Cameras(3)
    for name in ("a", "b", "c"):
        cameras.seen(name, 0.0)
    refused(cameras, "a", 0.0)
    assert (cameras.contradicting, cameras.doubts("a", 0.0)) == (("a",), False)
    refused(cameras, "b", 0.0)
    assert (cameras.contradicting, cameras.doubts("a", 0.0)) == (("a", "b"), True)
    refused(cameras, "c", 0.0)
    assert (cameras.contradicting, cameras.doubts("c", 0.0)) == ((), True)
    cameras.judged("c", is_refused=False)
    assert not cameras.doubts("c", 0.0)


def test_what_is_known_of_a_camera_outlives_the_silence_of_the_one_that_showed_it():
    """The question that was not asked: who says that a sensor that was found wrong is right now?

    A slipped camera was believed when the right one gave no image for half a second, and the right one was left out.
    """
    cameras = Cameras(3)
    for at in (0.0, 0.1):
        cameras.seen("right", at)
        cameras.judged("right", is_refused=False)
    refused(cameras, "slipped", 0.1)
    assert cameras.contradicting == ("slipped",)
    for at in (0.7, 1.0, 9.0):
        refused(cameras, "slipped", at)
        assert (cameras.contradicting, cameras.doubts("slipped", at)) == (("slipped",), False), at
        cameras.judged("slipped", is_refused=False)  # a blind estimate knows nothing better
        assert cameras.contradicting == ("slipped",)
    refused(cameras, "slipped", 9.1)
    cameras.seen("right", 9.1)
    cameras.judged("right", is_refused=False)
    assert cameras.contradicting == ("slipped",)
    cameras.judged("slipped", is_refused=False)
    assert (cameras.contradicting, cameras._records["slipped"].is_wrong) == ((), False), "they agree again"


def test_where_the_right_camera_is_refused_too_the_estimate_was_wrong_and_it_leads():
    cameras = Cameras(3)
    cameras.seen("right", 0.0)
    cameras.judged("right", is_refused=False)
    refused(cameras, "slipped", 0.1)
    refused(cameras, "slipped", 1.0)
    refused(cameras, "right", 1.1)
    assert (cameras.contradicting, cameras.doubts("right", 1.1), cameras.doubts("slipped", 1.1)) == (
        ("slipped",),
        True,
        False,
    )


def test_after_a_change_one_refused_image_is_enough():
    cameras = Cameras(3)
    cameras.seen("down", 0.0)
    cameras.expect_change()
    assert cameras.doubts("down", 0.0)
    assert Cameras(3).contradicting == ()


def command(at, tilt=0.1):
    return StickFrame(at, (tilt, 0.0), 0.0)


def test_a_stick_frame_that_would_act_before_an_earlier_one_acts_just_after_it():
    history = CommandHistory()
    history.add(command(1.0))
    history.add(command(0.5, 0.2))
    assert history.at(0.6) is NEUTRAL
    assert history.at(1.0).tilt == (0.2, 0.0)


def test_a_stick_frame_can_be_put_before_those_that_act_later():
    history = CommandHistory()
    for at, tilt in ((1.0, 0.1), (2.0, 0.2), (3.0, 0.3)):
        history.add(command(at, tilt))
    history.insert(command(1.5, 0.15))
    history.forget_after(2.0)
    assert [history.at(time).tilt[0] for time in (1.0, 1.4, 1.5, 1.9, 2.0, 9.0)] == [0.1, 0.1, 0.15, 0.15, 0.2, 0.2]


def test_stick_frames_are_remembered_for_two_seconds():
    history = CommandHistory()
    for k in range(1000):
        history.add(command(0.02 * k, 0.001 * k))
    newest = 0.02 * 999
    assert history.at(newest - KNOWN + 0.011).tilt[0] == pytest.approx(0.9, abs=2e-3)
    assert len(history._commands) <= KNOWN / 0.02 + 3


def test_sticks_that_were_lost_neither_tilt_nor_lift_the_aircraft():
    """All of them acted in the estimate for a time before the board's word came."""
    lost, never_sent = (Estimator(AircraftModel(), level_view(), HOVER) for _ in range(2))
    for estimator in (lost, never_sent):
        estimator.sent(StickCommand(0.0, 0.0, 0.0, 0.0, HOVER))
    lost.sent(StickCommand(0.05, 20.0, 0.0, 0.0, HOVER + 40.0))
    lost.advance(0.4)
    assert lost.estimate(0.4).velocity[2] > 0.2
    lost.sticks_lost(0.0, [])
    for found, expected in zip(
        (lost.estimate(0.4).axes, lost.estimate(0.4).vertical),
        (never_sent.estimate(0.4).axes, never_sent.estimate(0.4).vertical),
        strict=True,
    ):
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("yaw", [0.0, 0.7, 1.9, -2.4])
@pytest.mark.parametrize(("pitch", "roll"), [(20.0, 0.0), (0.0, 20.0)])
def test_sticks_tilt_the_aircraft_in_the_axes_of_its_nose(yaw, pitch, roll):
    estimator = Estimator(AircraftModel(), level_view(yaw=yaw), HOVER, compass=0.4)
    estimator.sent(StickCommand(0.0, pitch, roll, 0.0, HOVER))
    ahead = estimator.estimate(0.4)
    # Pitch accelerates forwards, roll to the right.
    way = np.array([np.cos(yaw), np.sin(yaw)]) if pitch else np.array([np.sin(yaw), -np.cos(yaw)])
    assert ahead.tilt == pytest.approx(np.linalg.norm(ahead.tilt) * way, abs=1e-6)
    assert np.linalg.norm(ahead.tilt) > 0.03
    assert ahead.yaw == pytest.approx(yaw)
