"""The target that is followed, and what is believed against it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.estimator.liftoff import LiftOff
from mkdaemon.control.estimator.model import LEVEL_STATES, NO_FILTER, AircraftModel, D, P, T, V
from mkdaemon.control.estimator.values import GAS_CENTRE, OURS, TargetView, ViewFault
from mkdaemon.control.limiter import StickCounts
from mkdaemon.control.sight import FORGOTTEN, Sight, checked_view, turned, velocity_between, view_of
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.link import LinkHealth
from mkdaemon.telemetry.state import AngleScale, Attitude
from tests.control.events import pose
from tests.values import made

CFG = AutopilotConfig()
HOVER = -2.0


def view(at, place=(0.0, 0.0, 2.0), *, yaw=0.0, camera="down", covariance=1e-4):
    """What a level aircraft at a place sees."""
    c, s = math.cos(yaw), math.sin(yaw)
    r = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return TargetView(at, -r.T @ np.array(place), r, covariance * np.eye(6), camera)


def see(sight, seen, *, target="pad", lifted=None, may_change=True):
    return sight.view_received(target, seen, seen.at, lifted=lifted, may_change=may_change)


@pytest.fixture
def sight():
    followed = Sight(CFG, HOVER)
    see(followed, view(10.0))
    return followed


def test_before_the_first_image_nothing_is_known():
    sight = Sight(CFG, HOVER)
    assert (sight.target, sight.is_fresh(0.0), sight.contradicting) == ("", False, ())
    assert (sight.pose_age(0.0), sight.hover_throttle(0.0), sight.entry(0.0), sight.estimate(0.0)) == (None,) * 4
    assert sight.hover_gas == HOVER + GAS_CENTRE


def test_an_image_is_fresh_until_flight_by_it_ends(sight):
    limit = CFG.level_after
    assert [sight.is_fresh(10.0 + age) for age in (0.0, limit - 1e-6, limit + 1e-6)] == [True, True, False]
    assert [sight.hover_throttle(10.0 + age) for age in (limit - 1e-6, limit + 1e-6)] == [pytest.approx(HOVER), None]


def test_the_age_of_the_newest_image_is_that_of_its_exposure_whatever_comes_late(sight):
    assert sight.pose_age(10.5) == 0.5
    see(sight, view(10.2))
    see(sight, view(10.1))
    assert sight.pose_age(10.5) == pytest.approx(0.3)


def test_a_target_counts_as_in_sight_for_a_second(sight):
    sight.seen("pad", 10.0)
    sight.seen("other", 10.4)
    assert [sight.in_sight(at) for at in (11.0, 11.01, 11.4, 11.41)] == [("other", "pad"), ("other",), ("other",), ()]


@pytest.mark.parametrize("trips", ["confirm", "echo"])
def test_a_slower_line_adds_half_of_what_its_round_trips_take_longer_than_a_cables(trips):
    sight, ages = Sight(CFG, HOVER), []
    for trip in (0.0, 0.0125, 0.0525, 0.1125):
        sight.link_measured(made(LinkHealth, **{trips: {"p50_ms": 1000.0 * trip}}))
        ages.append(sight.attitude_age)
    assert [age - ages[0] for age in ages] == pytest.approx([0.0, 0.0, 0.02, 0.05])


@pytest.mark.parametrize(
    ("after", "may_change", "followed"),
    [
        (5.0 + 0.01, True, "other"),
        (5.0 - 0.01, True, "pad"),
        (5.0 + 0.01, False, "pad"),
    ],
)
def test_another_target_is_followed_only_after_a_long_time_and_while_nothing_is_flown(
    sight, after, may_change, followed
):
    before = see(sight, view(10.0 + after), target="other", may_change=may_change)
    assert (before, sight.target) == ("pad" if followed == "other" else "", followed)


@pytest.mark.parametrize(("after", "is_new"), [(5.0 - 0.01, False), (FORGOTTEN + 0.01, True)])
def test_the_same_target_is_met_anew_after_a_long_time(sight, after, is_new):
    first = sight.estimator
    assert see(sight, view(10.0 + after), may_change=False) == ""
    assert (sight.estimator is not first) is is_new


def test_an_aircraft_that_leaves_the_ground_is_met_anew_with_its_throttle_and_the_frames_sent(sight):
    first = sight.estimator
    for k in range(110):
        sight.sticks_made(StickCounts(20, 0, 0, 3), OURS, 8.0 + 0.02 * k)
    see(sight, view(10.2), lifted=LiftOff(140.0, 0.0, 0.0))
    estimator = sight.estimator
    assert estimator is not first
    assert estimator.hover_gas == 140.0
    assert estimator._last_command.at == pytest.approx(8.0 + 0.02 * 109)
    assert estimator._last_command.gas == 3 + GAS_CENTRE
    assert estimator.estimate(10.6).tilt[0] > 0.05, "it knows the sticks that were sent before"


def test_a_target_that_is_met_anew_in_the_air_knows_no_frames_of_before():
    sight = Sight(CFG, HOVER)
    for k in range(20):
        sight.sticks_made(StickCounts(20, 0, 0, 3), OURS, 9.6 + 0.02 * k)
    see(sight, view(10.0))
    assert sight.estimator.estimate(10.4).tilt[0] == pytest.approx(0.0)


def test_a_stick_frame_is_taken_as_it_was_made(sight):
    sight.sticks_made(StickCounts(1, 2, 3, 4), OURS, 10.1)
    command = sight.estimator._last_command
    assert (command.at, command.pitch, command.roll, command.yaw, command.gas) == (10.1, 1, 2, 3, 4 + GAS_CENTRE)


def test_entry_looks_at_speed_with_climb_offset_over_the_ground_the_least_certain_axis_and_clean_images(sight):
    estimator, axes = sight.estimator, np.zeros((2, LEVEL_STATES))
    axes[:, [P, V]] = [[0.3, -0.6], [-0.4, 0.8]]
    found = replace(
        estimator.estimate(10.3),
        axes=axes,
        vertical=np.array([1.7, 5.0, 0.0, 0.0]),
        position_sd=np.array([0.01, 0.03, 0.02]),
        age=0.3,
    )
    estimator.estimate = lambda now: found
    entry = sight.entry(10.3)
    assert (entry.target, entry.age, entry.height) == ("pad", 0.3, 1.7)
    assert (entry.speed, entry.offset, entry.sd) == pytest.approx((5.1, 0.5, 0.03), abs=1e-2)
    assert entry.clean == pytest.approx(0.3)


@pytest.mark.parametrize(("apart", "is_certain"), [(0.03, True), (0.33, True), (0.6, False), (1.0, False)])
def test_place_is_as_certain_as_it_will_be_when_the_next_image_comes(apart, is_certain):
    """By two images a second a flight began: seconds later the target was out of view, and it was released."""
    sight = Sight(CFG, HOVER)
    for k in range(round(4.0 / apart) + 1):
        see(sight, view(10.0 + apart * k))
        sight.estimator.advance(10.0 + apart * (k + 0.9))
    assert bool(sight.entry(10.0 + apart * k + 0.05).sd <= CFG.entry_sd) is is_certain


def test_images_are_clean_since_the_last_one_that_disagreed(sight):
    for k in range(1, 5):
        see(sight, view(10.0 + 0.1 * k))
    assert sight.entry(10.4).clean == pytest.approx(0.4)
    sight.estimator.innovation = 100.0
    see(sight, view(10.5))
    assert sight.entry(10.6).clean == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("step", "has_one"),
    [
        (0.02 - 0.001, False),
        (0.02 + 0.001, True),
        (0.2 - 0.001, True),
        (0.2 + 0.001, False),
        (-0.1, False),
    ],
)
def test_two_images_a_little_apart_give_a_velocity(step, has_one):
    velocity = velocity_between(view(10.0), view(10.0 + step, (0.1 * step, 0.2 * step, 2.0 + 0.3 * step)))
    assert (velocity is not None) is has_one
    if has_one:
        assert velocity == pytest.approx([0.1, 0.2, 0.3])


def test_two_cameras_or_one_image_give_none():
    assert velocity_between(view(10.0, camera="down"), view(10.1, camera="forward")) is None
    assert velocity_between(None, view(10.0)) is None


def test_a_velocity_is_that_over_the_ground_whatever_the_heading():
    velocity = velocity_between(view(10.0, yaw=1.0), view(10.1, (0.1, 0.0, 2.0), yaw=1.0))
    assert velocity == pytest.approx([1.0, 0.0, 0.0])


def test_to_turn_is_counter_clockwise():
    assert turned(np.array([1.0, 0.0, 5.0]), math.pi / 2.0) == pytest.approx([0.0, 1.0, 5.0])
    assert turned(np.array([0.0, 1.0, 5.0]), math.pi / 2.0) == pytest.approx([-1.0, 0.0, 5.0])


def test_a_target_met_anew_soon_after_begins_with_the_speed_that_two_images_show():
    sight = Sight(CFG, HOVER)
    see(sight, view(10.0))
    see(sight, view(10.1, (0.05, 0.0, 2.0)), lifted=LiftOff(120.0, 0.0, 0.0))
    assert sight.estimator.estimate(10.1).velocity[0] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_a_pose_whose_attitude_is_no_number_is_none(number):
    broken = pose(10.0).model_copy(update={"quaternion_target_from_flu": (1.0, number, 0.0, 0.0)})
    assert checked_view(broken, 10.0) is ViewFault.NOT_FINITE
    assert isinstance(checked_view(pose(10.0), 10.0), TargetView)


def test_what_is_published_is_what_is_believed(sight):
    shown, found = sight.estimate(10.1), sight.estimator.estimate(10.1)
    spread = sight.estimator.motion_covariance
    assert (shown.target, shown.yaw, shown.image_age) == ("pad", found.yaw, pytest.approx(0.1))
    assert shown.position == pytest.approx(tuple(found.position))
    assert shown.velocity == pytest.approx(tuple(found.velocity))
    assert shown.tilt == pytest.approx(tuple(found.tilt))
    assert shown.disturbance == pytest.approx(tuple(found.disturbance))
    assert shown.position_sd == pytest.approx(tuple(found.position_sd))
    assert shown.hover_throttle == pytest.approx(HOVER)
    assert np.array(shown.covariance) == pytest.approx(spread)
    assert len({tuple(row) for row in shown.covariance}) > 1


def told(at, *, pitch=0.1, roll=0.0, yaw=0.4, scale=AngleScale.FLIGHTCTRL):
    """What a board reports of the attitude."""
    angles = {"quaternion": (1.0, 0.0, 0.0, 0.0), "pitch": pitch, "roll": roll, "yaw": yaw}
    return Attitude(stamp=Stamp(monotonic=at, wall=at), source="fc/data3d", scale=scale, **angles)


@pytest.mark.parametrize(("scale", "shown_as"), [(AngleScale.FLIGHTCTRL, 1.13), (AngleScale.STICKS, 1.0)])
def test_an_attitude_is_of_before_it_arrived_and_a_flightctrls_angles_are_larger_than_they_are(sight, scale, shown_as):
    heard = []
    sight.estimator.attitude_received = lambda *told: heard.append(told)
    sight.attitude_received(told(10.5, pitch=0.1, roll=-0.2, scale=scale))
    assert heard == [pytest.approx((10.5 - sight.model.attitude_age, 0.1 / shown_as, -0.2 / shown_as, 0.4))]
    assert sight.attitude.yaw == 0.4


def test_a_target_is_met_with_the_heading_that_the_boards_reported_last():
    sight = Sight(CFG, HOVER)
    sight.attitude_received(told(9.99, pitch=0.0))
    see(sight, view(10.0, yaw=1.0))
    sight.attitude_received(told(10.1, pitch=0.0, yaw=0.6))
    assert sight.estimator.estimate(10.1).yaw == pytest.approx(1.2)


def test_another_aircraft_is_met_anew_and_the_same_is_not(sight):
    first, answers = sight.estimator, sight.answer
    sight.model_known(AircraftModel())
    assert (sight.estimator, sight.answer) == (first, answers)
    other = AircraftModel(drag=0.5)
    sight.model_known(other)
    assert sight.estimator is None
    assert sight.answer is not answers, "it expects the answers of the aircraft before"
    see(sight, view(10.1))
    assert sight.estimator.model == other


def test_on_the_ground_nothing_is_estimated_and_the_target_is_known(sight):
    sight.stand(is_standing=True)
    assert (sight.is_standing, sight.estimator) == (True, None)
    see(sight, view(10.1), target="other")
    assert (sight.estimator, sight.target) == (None, "other"), "it was forgotten with the estimate"
    assert sight.pose_age(10.3) == pytest.approx(0.2)
    see(sight, view(10.2), target="other", lifted=LiftOff(130.0, 0.0, 0.0))
    assert sight.estimator.hover_gas == 130.0
    sight.stand(is_standing=False)
    assert not sight.is_standing
    assert sight.estimator is not None


def test_who_is_met_anew_in_the_air_is_carried_by_the_throttle_that_is_configured(sight):
    see(sight, view(10.1 + 5.0))
    assert sight.estimator.hover_gas == HOVER + GAS_CENTRE


def test_feet_that_stood_fly_after_images_of_a_while_or_a_lift_off(sight):
    low, high = (0.0, 0.0, 0.1), (0.0, 0.0, 1.0)
    see(sight, view(10.1, low))
    assert sight.has_come_down
    see(sight, view(10.2, high))
    see(sight, view(10.45, high))
    assert sight.has_come_down, "images of 0.25 s"
    see(sight, view(10.5, high))
    assert not sight.has_come_down
    see(sight, view(10.6, low))
    assert sight.has_come_down, "one image"
    see(sight, view(10.7, high), lifted=LiftOff(130.0, 0.0, 0.0))
    assert not sight.has_come_down


def test_images_are_clean_since_a_target_was_met():
    sight = Sight(CFG, HOVER)
    see(sight, view(10.0))
    assert sight.entry(10.7).clean == pytest.approx(0.7)
    see(sight, view(10.1), lifted=LiftOff(130.0, 0.0, 0.0))
    assert sight.entry(10.7).clean == pytest.approx(0.6)


@pytest.mark.parametrize(("innovation", "is_clean"), [(3.9, True), (4.2, False), (math.nan, False)])
def test_images_that_agree_within_four_variances_are_clean(sight, innovation, is_clean):
    sight.estimator.target_seen = lambda seen, now: setattr(sight.estimator, "innovation", innovation)
    see(sight, view(10.5))
    assert sight.entry(10.6).clean == pytest.approx(0.6 if is_clean else 0.1)
    assert CFG.clean_innovation == 4.0


def test_another_target_is_met_without_the_speed_against_the_one_before():
    sight = Sight(CFG, HOVER)
    see(sight, view(10.0))
    sight.stand(is_standing=True)
    see(sight, view(10.1, (0.05, 0.0, 2.0)), target="other", lifted=LiftOff(130.0, 0.0, 0.0))
    assert sight.estimator.estimate(10.1).velocity[:2] == pytest.approx([0.0, 0.0], abs=0.01)


def test_what_is_told_of_an_estimate_is_the_estimators(sight):
    estimator = sight.estimator
    estimator.innovation, estimator.caution, estimator.model = 2.5, 0.25, AircraftModel().with_other_filter()
    shown = sight.estimate(10.1)
    assert (shown.innovation, shown.caution) == (2.5, 0.25)
    assert (shown.stick_gain, shown.stick_filter) == (1.0, NO_FILTER)
    assert shown.contradicting == sight.contradicting == ()


def test_of_an_aircraft_below_its_target_nothing_is_told():
    sight = Sight(CFG, HOVER)
    see(sight, view(10.0, (0.0, 0.0, -0.5)))
    assert sight.estimator is not None
    assert sight.estimate(10.0) is None


def test_a_camera_that_contradicts_is_told(sight):
    for name in ("down", "forward"):
        sight.estimator._cameras.seen(name, 10.0)
    for _ in range(3):
        sight.estimator._cameras.judged("forward", is_refused=True)
    assert sight.contradicting == ("forward",)
    assert sight.estimate(10.0).contradicting == ("forward",)


def test_a_pose_becomes_a_view_of_the_same_numbers():
    half = math.sqrt(0.5)
    seen = pose(10.0).model_copy(
        update={
            "position_flu": (1.0, 2.0, -3.0),
            "quaternion_target_from_flu": (half, 0.0, 0.0, half),
            "covariance": tuple(float(min(divmod(k, 6))) for k in range(36)),
        }
    )
    found = view_of(seen)
    assert (found.at, found.camera, tuple(found.position_flu)) == (10.0, "down", (1.0, 2.0, -3.0))
    assert found.heading == pytest.approx(math.pi / 2.0)
    assert found.covariance.shape == (6, 6)
    assert found.covariance[3, 5] == 3.0


@pytest.mark.parametrize(("ahead", "fault"), [(0.02, None), (0.021, ViewFault.FUTURE), (-0.81, ViewFault.TOO_OLD)])
def test_a_pose_is_checked_against_the_time_it_arrives(ahead, fault):
    found = checked_view(pose(10.0 + ahead), 10.0)
    assert (found is fault) if fault else isinstance(found, TargetView)


def test_tilt_and_disturbance_are_told_along_their_own_axes(sight):
    sight.estimator._level.shift(D, np.array([0.3, -0.2]))
    sight.estimator._level.shift(T, np.array([0.1, -0.05]))
    shown = sight.estimate(10.0)
    assert shown.disturbance == pytest.approx((0.3, -0.2), abs=0.02)
    assert shown.tilt == pytest.approx((0.1, -0.05), abs=0.02)


def tilt_by_sticks(sight, now):
    """Tilt that is believed a third of a second after full sticks [rad]."""
    for k in range(10):
        sight.sticks_made(StickCounts(60, 0, 0, 0), OURS, now + 0.03 * k)
    return sight.estimate(now + 0.33).tilt[0]


def test_while_the_pilot_flies_sticks_that_are_sent_do_not_act(sight):
    sight.leave_to_pilot(is_his=True)
    assert sight.estimator is None
    see(sight, view(10.1))
    met = sight.estimator
    sight.leave_to_pilot(is_his=True)
    assert sight.estimator is met, "forgotten once"
    assert abs(tilt_by_sticks(sight, 10.1)) < 0.01
    sight.leave_to_pilot(is_his=False)
    assert sight.estimator is met
    see(sight, view(10.5))
    assert tilt_by_sticks(sight, 10.5) > 0.1


def test_throttle_that_carried_while_sticks_acted_is_what_the_pilot_leaves():
    sight = Sight(CFG, HOVER)
    see(sight, view(10.0))
    sight.estimator.hover_gas = 140.0
    sight.leave_to_pilot(is_his=True)
    assert sight.hover_gas == HOVER + GAS_CENTRE, "nobody knows whether they acted"
    sight.leave_to_pilot(is_his=False)
    see(sight, view(10.1))
    sight.estimator.hover_gas = 140.0
    sight.answer._evidence -= 2.0
    sight.attitude_received(told(10.15))
    sight.leave_to_pilot(is_his=True)
    assert sight.hover_gas == 140.0


def test_how_sure_it_is_published_to_be_is_of_the_moment(sight):
    early, late = (np.trace(sight.estimate(at).covariance) for at in (10.0, 10.3))
    assert late > 1.5 * early


def test_how_sure_it_is_published_to_be_is_told_of_each_axis():
    sight = Sight(CFG, HOVER)
    for k in range(5):
        seen = view(10.0 + 0.04 * k)
        see(sight, replace(seen, covariance=np.diag([1e-4, 9e-4, 4e-4, 1e-4, 1e-4, 1e-4])))
    east, north, up = sight.estimate(10.2).covariance
    assert len({east, north, up}) == 3
    assert np.array([east, north, up]) == pytest.approx(sight.estimator.motion_covariance)


def test_an_estimate_that_stands_on_a_contradicted_source_alone_is_dropped(sight):
    assert not sight.discredit("mocap")
    assert sight.estimator is not None
    assert sight.discredit("down")
    assert sight.estimator is None
    assert not sight.discredit("down")


def test_an_estimate_on_which_another_camera_agrees_is_kept(sight):
    see(sight, view(10.02, camera="mocap"))
    assert not sight.discredit("mocap")
    assert sight.estimator is not None


def test_after_a_source_was_contradicted_the_estimate_restarts_by_another_camera(sight):
    see(sight, view(10.02, camera="mocap"))
    before = sight.estimator
    assert before.uses("mocap")
    assert not sight.discredit("mocap")
    see(sight, view(10.04, camera="mocap"))
    assert sight.estimator is before
    see(sight, view(10.06))
    restarted = sight.estimator
    assert restarted is not before
    assert not restarted.uses("mocap")
    assert not sight.discredit("mocap")
    see(sight, view(10.09))
    assert sight.estimator is restarted
