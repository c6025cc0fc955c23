"""The estimator on an aircraft that obeys its own model: it finds position, speed, wind, level error and heading."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mkdaemon.control.estimator.cameras import TOGETHER, Cameras
from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import GRAVITY, LEVEL_STATES, TH, AircraftModel, B, D, P, S, T, V
from mkdaemon.control.estimator.rollback import MEMORY, STEP, RollbackFilter
from mkdaemon.control.estimator.values import FUTURE, OURS, StickCommand, TargetView, ThrottleUse, ViewFault, fault_of
from mkdaemon.control.regulator.horizontal import HorizontalCosts, HorizontalRegulator
from mkdaemon.control.regulator.reference import Reference

MODEL = AircraftModel()
HOVER = 125.0


def view(at, axes, height, yaw):
    """What a perfect image shows of a target at the origin."""
    tilt = axes[:, T]
    up = np.array([tilt[0], tilt[1], 1.0]) / math.sqrt(1 + tilt @ tilt)
    forward = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    rotation = np.column_stack([np.cross(left, up), left, up])
    place = np.array([axes[0, P], axes[1, P], height])
    return TargetView(at, rotation.T @ -place, rotation, np.diag([1e-6] * 3 + [1e-6] * 3))


class Plant:
    """The model itself, flown by pitch and roll sticks."""

    def __init__(self, *, yaw=0.0, wind=(0.0, 0.0), level=(0.0, 0.0)):
        self.f, self.g = MODEL.horizontal(STEP)
        self.axes = np.zeros((2, LEVEL_STATES))
        self.axes[:, D], self.axes[:, B] = wind, level
        self.yaw, self.now, self.queue = yaw, 0.0, []
        self.tilt = np.zeros(2)

    def stick(self, pitch, roll):
        """Sticks that act `uplink` from now on; returns the frame as written."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        k = MODEL.rad_per_count
        self.queue.append((self.now + MODEL.uplink, k * np.array([pitch * c + roll * s, pitch * s - roll * c])))
        return StickCommand(self.now, pitch, roll, 0.0, HOVER)

    def step(self):
        while self.queue and self.queue[0][0] <= self.now + STEP / 2:
            self.tilt = self.queue.pop(0)[1]
        self.axes = self.axes @ self.f.T + self.tilt[:, None] * self.g
        self.now += STEP

    def reported(self):
        """Pitch and roll as the FlightCtrl believes them."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        x, y = self.axes[:, TH]
        return x * c + y * s, x * s - y * c


def leaning(degrees):
    """State of an aircraft that leans along x."""
    axes = np.zeros((2, LEVEL_STATES))
    axes[0, T] = math.radians(degrees)
    return axes


def path(now):
    """A slow figure to fly."""
    return Reference(np.array([0.3 * math.sin(now), 0.3 * math.cos(0.7 * now)]))


def run(plant, seconds, delay=8, sight=lambda t: True):
    """Fly little steps; images come late; returns the estimator."""
    estimator, pending, regulator = None, [], HorizontalRegulator(MODEL, HorizontalCosts())
    for k in range(round(seconds / STEP)):
        if k % 3 == 0 and sight(plant.now):
            pending.append((k + delay, view(plant.now, plant.axes, 2.0, plant.yaw)))
        while pending and pending[0][0] <= k:
            seen = pending.pop(0)[1]
            if estimator is None:
                estimator = Estimator(MODEL, seen, HOVER)
            estimator.advance(plant.now)
            estimator.target_seen(seen, plant.now)
        if estimator is not None and k % 2 == 0:
            estimator.attitude_received(plant.now, *plant.reported(), plant.yaw + 0.4)
            tilt = regulator.tilt(estimator.estimate(plant.now + MODEL.uplink), path(plant.now)) / MODEL.rad_per_count
            c, s = math.cos(plant.yaw), math.sin(plant.yaw)
            pitch, roll = tilt[0] * c + tilt[1] * s, tilt[0] * s - tilt[1] * c
            estimator.sent(plant.stick(round(pitch), round(roll)))
        plant.step()
    estimator.advance(plant.now)
    return estimator


@cache
def _flown():
    plant = Plant()
    return plant, run(plant, 5.0)


def flown():
    """An estimator of an aircraft that flew for 5 s; each test gets its own."""
    return deepcopy(_flown()[1])


def test_position_speed_wind_and_crooked_accelerometers_are_found_although_images_are_late():
    plant = Plant(yaw=0.7, wind=(0.2, -0.1), level=(0.02, 0.01))
    estimate = run(plant, 18.0).estimate(plant.now)
    assert estimate.position[:2] == pytest.approx(plant.axes[:, P], abs=0.02)
    assert estimate.velocity[:2] == pytest.approx(plant.axes[:, V], abs=0.05)
    assert estimate.tilt == pytest.approx(plant.axes[:, T], abs=0.01)
    assert estimate.position[2] == pytest.approx(2.0, abs=0.02)
    assert estimate.yaw == pytest.approx(0.7, abs=0.02)
    assert estimate.disturbance == pytest.approx([0.2, -0.1], abs=0.08)
    assert estimate.axes[:, B] == pytest.approx([0.02, 0.01], abs=0.006)


def test_without_images_the_estimate_goes_on_and_grows_uncertain():
    plant = Plant(wind=(0.3, 0.0))
    estimator = run(plant, 6.0, sight=lambda t: t < 5.0)
    estimate = estimator.estimate(plant.now)
    assert estimate.age == pytest.approx(1.0, abs=0.1)
    assert estimate.position[:2] == pytest.approx(plant.axes[:, P], abs=0.25)
    assert estimate.position_sd[0] > 2 * flown().estimate(5.0).position_sd[0]


def test_one_first_image_whose_tilt_is_wrong_moves_the_estimate_little():
    wrong = view(0.0, leaning(5.0), 2.0, 0.0)
    tilted = wrong.target_from_flu
    seen = np.array([0.0, 0.0, -2.0])  # level, over the middle
    covariance = np.diag([0.17**2, 0.17**2, 0.01**2, 0.085**2, 0.085**2, 0.01**2])
    covariance[0, 4] = covariance[4, 0] = 0.999 * 0.17 * 0.085
    covariance[1, 3] = covariance[3, 1] = -0.999 * 0.17 * 0.085
    estimator = Estimator(MODEL, TargetView(0.0, seen, tilted, covariance), HOVER)
    estimator.attitude_received(0.0, 0.0, 0.0, 0.0)
    estimate = estimator.estimate(0.0)
    assert abs(estimate.tilt[0]) < math.radians(1.5)
    assert abs(estimate.position[0]) < 0.05


def test_throttle_that_makes_up_for_a_lean_lifts_nothing():
    estimator = Estimator(MODEL, view(0.0, leaning(20.0), 2.0, 0.0), HOVER)
    estimator.attitude_received(0.0, math.radians(20.0), 0.0, 0.0)
    gas = HOVER / math.sqrt(math.cos(estimator.estimate(0.0).tilt[0]))
    for k in range(10):
        estimator.sent(StickCommand(0.02 * k, 44.0, 0.0, 0.0, gas))
    estimator.advance(0.2)
    assert estimator.estimate(0.2).vertical[S] == pytest.approx(0.0, abs=0.03)


def test_the_stick_filter_that_the_aircraft_has_replaces_the_models():
    model, plant = MODEL.with_other_filter(), Plant()
    estimator = Estimator(model, view(0.0, plant.axes, 2.0, 0.0), HOVER)
    for k in range(150):
        estimator.advance(plant.now)
        if k % 2 == 0:
            estimator.attitude_received(plant.now, *plant.reported(), 0.0)
            estimator.sent(plant.stick(round(15 * math.sin(5 * plant.now)), round(15 * math.cos(4 * plant.now))))
        if k % 3 == 0:
            estimator.target_seen(view(plant.now, plant.axes, 2.0, 0.0), plant.now)
        plant.step()
    assert estimator.model.stick_filter == MODEL.stick_filter
    assert estimator.model.uplink == pytest.approx(MODEL.uplink, abs=0.005)
    assert estimator.estimate(plant.now).tilt == pytest.approx(plant.axes[:, T], abs=0.01)


def test_an_estimate_ahead_knows_the_sticks_under_way():
    plant, estimator = deepcopy(_flown())
    estimator.sent(plant.stick(30, 0))
    ahead = estimator.estimate(plant.now + 0.3)
    for _ in range(30):
        plant.step()
    assert ahead.tilt[0] == pytest.approx(plant.axes[0, T], abs=0.02)
    assert ahead.position[0] == pytest.approx(plant.axes[0, P], abs=0.03)


NOT_OURS = ThrottleUse(None, is_ours=False)


@pytest.mark.parametrize(
    ("use", "sent"), [(NOT_OURS, HOVER), (ThrottleUse(110.0, is_ours=False), HOVER), (OURS, HOVER - 2.0)]
)
def test_what_does_not_act_as_it_was_asked_for_teaches_nothing_about_hover(use, sent):
    estimator = flown()
    estimator._vertical.shift(3, np.array([-0.5]))
    estimator.sent(StickCommand(5.0, 0.0, 0.0, 0.0, sent, use))
    for _ in range(100):
        estimator.recentre_hover(0.02, HOVER)
    assert estimator.hover_gas == HOVER
    estimator.sent(StickCommand(5.0, 0.0, 0.0, 0.0, HOVER - 1.0, OURS))
    estimator.recentre_hover(0.02, HOVER)
    assert estimator.hover_gas > HOVER


def test_before_any_stick_frame_nothing_is_learnt_about_hover():
    estimator = Estimator(MODEL, view(0.0, np.zeros((2, LEVEL_STATES)), 2.0, 0.0), HOVER)
    estimator._vertical.shift(3, np.array([-0.5]))
    estimator.recentre_hover(0.02, HOVER)
    assert (estimator.hover_gas, estimator.throttle_cap) == (HOVER, None)


@pytest.mark.parametrize(("cap", "sinks"), [(None, False), (HOVER + 5.0, False), (HOVER - 15.0, True)])
def test_the_throttle_that_acts_is_the_smaller_of_ours_and_the_pilots(cap, sinks):
    estimator = Estimator(MODEL, view(0.0, np.zeros((2, LEVEL_STATES)), 2.0, 0.0), HOVER)
    for k in range(20):
        estimator.sent(StickCommand(0.02 * k, 0.0, 0.0, 0.0, HOVER, ThrottleUse(cap, is_ours=cap is None)))
    estimator.advance(0.5)
    assert estimator.throttle_cap == cap
    climb = estimator.estimate(0.5).vertical[S]
    assert (climb < -0.5) if sinks else climb == pytest.approx(0.0, abs=0.01)


def test_while_nobody_here_sends_sticks_they_ask_for_the_tilt_that_is_reported():
    plant = Plant(wind=(1.0, -0.5))
    estimator = Estimator(MODEL, view(0.0, plant.axes, 2.0, 0.0), HOVER)
    lean = -plant.axes[:, D] / GRAVITY
    plant.axes[:, TH] = plant.axes[:, T] = lean
    for k in range(400):  # a pilot holds it against the wind
        now = 0.01 * k
        estimator.advance(now)
        if k % 2 == 0:
            estimator.attitude_received(now, lean[0], -lean[1], 0.0)
        if k % 3 == 0:
            estimator.target_seen(view(now, plant.axes, 2.0, 0.0), now)
    found = estimator.estimate(4.0)
    assert estimator.innovation < 1.0
    assert found.disturbance == pytest.approx(plant.axes[:, D], abs=0.1)
    assert found.velocity[:2] == pytest.approx([0.0, 0.0], abs=0.05)


@pytest.mark.parametrize("wrong", [1.0, -1.0, 5.0])
def test_a_height_that_every_image_contradicts_is_given_up(wrong):
    plant = Plant()
    estimator = Estimator(MODEL, view(0.0, plant.axes, 2.0, 0.0), HOVER)
    for k in range(100):
        estimator.advance(0.01 * k)
        estimator.target_seen(view(0.01 * k, plant.axes, 2.0, 0.0), 0.01 * k)
    for k in range(100, 110):
        estimator.advance(0.01 * k)
        estimator.target_seen(view(0.01 * k, plant.axes, 2.0 + wrong, 0.0), 0.01 * k)
    assert estimator.estimate(1.1).position[2] == pytest.approx(2.0 + wrong, abs=0.2)


@pytest.fixture
def steps(monkeypatch):
    """Every step that both filters went or looked ahead."""
    taken, advance, ahead = [], RollbackFilter.advance, RollbackFilter.ahead

    def counted(self, drive, doubted=None):
        taken.append(drive)
        advance(self, drive, doubted)

    def looked(self, drives):
        taken.extend(drives)
        return ahead(self, drives)

    monkeypatch.setattr(RollbackFilter, "advance", counted)
    monkeypatch.setattr(RollbackFilter, "ahead", looked)
    return taken


def silent(seconds):
    """An estimator that has heard nothing for a while, and the moment."""
    estimator = flown()
    return estimator, 5.0 + seconds


@pytest.mark.parametrize("seconds", [2.0, 60.0, 600.0, 1e6])
@pytest.mark.parametrize("what", ["attitude", "moment", "question"])
def test_catching_up_after_a_silence_takes_no_more_steps_than_are_remembered(what, seconds, steps):
    estimator, now = silent(seconds)
    steps.clear()
    match what:
        case "attitude":
            estimator.attitude_received(now, 0.01, -0.02, 0.3)
        case "moment":
            estimator.advance(now)
        case "question":
            estimator.estimate(now)
    assert len(steps) <= 2 * 2 * round(MEMORY / STEP)


def test_a_silence_within_the_memory_is_caught_up_step_by_step(steps):
    estimator, now = silent(MEMORY - 0.1)
    steps.clear()
    estimator.advance(now)
    assert len(steps) == pytest.approx(2 * round((MEMORY - 0.1) / STEP), abs=2)


@pytest.mark.parametrize("seconds", [5.0, 60.0, 600.0])
def test_after_a_silence_the_estimate_is_as_uncertain_as_it_is_old(seconds):
    estimator, now = silent(seconds)
    estimator.caution = 0.0
    estimator.advance(now)
    found = estimator.estimate(now)
    assert np.isfinite(found.axes).all()
    assert found.position_sd.min() > min(1.0 * seconds, 50.0), "anybody may have flown it anywhere"
    assert estimator.caution == 1.0
    assert found.age == pytest.approx(seconds, abs=0.2)
    for covariances in (estimator._level.covariances, estimator._vertical.covariances):
        assert np.linalg.eigvalsh(covariances).min() > 0.0


def test_after_a_silence_the_next_images_are_believed_wherever_they_show_the_aircraft():
    plant = Plant()
    estimator, now = silent(60.0)
    plant.axes[:, P] = 1.5, -2.0
    for k in range(100):
        at = now + 0.02 * k
        estimator.advance(at)
        estimator.attitude_received(at, 0.0, 0.0, 0.4)
        estimator.target_seen(view(at, plant.axes, 3.0, 0.0), at)
    found = estimator.estimate(now + 2.0)
    assert found.position == pytest.approx([1.5, -2.0, 3.0], abs=0.05)
    assert found.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    assert estimator.innovation < 1.5


WRONG = {
    ViewFault.NOT_FINITE: [
        {"at": math.nan},
        {"position_flu": np.array([0.0, math.inf, -2.0])},
        {"target_from_flu": np.full((3, 3), math.nan)},
        {"covariance": np.diag([1e-4] * 5 + [math.nan])},
    ],
    ViewFault.TOO_FAR: [{"position_flu": np.array([0.0, 0.0, -1001.0])}, {"covariance": np.diag([1e-4] * 5 + [1e7])}],
    ViewFault.NO_ROTATION: [{"target_from_flu": np.diag([1.0, 1.0, -1.0])}, {"target_from_flu": 1.1 * np.eye(3)}],
    ViewFault.NO_COVARIANCE: [
        {"covariance": np.zeros((6, 6))},
        {"covariance": np.diag([1e-4] * 5 + [-1e-4])},
        {"covariance": np.diag([1e-4] * 6) + 1e-5 * np.eye(6, k=1)},
    ],
    ViewFault.CALIBRATION: [{"calibration_sd": (0.1, 0.1, 0.0)}, {"calibration_sd": (0.0, -0.0028, 0.0)}],
    ViewFault.FUTURE: [{"at": 5.0 + FUTURE + 0.001}, {"at": 1e9}],
    ViewFault.TOO_OLD: [{"at": 5.0 - MEMORY - 0.001}, {"at": -1e9}],
}
EACH = [(fault, change) for fault, changes in WRONG.items() for change in changes]


@pytest.mark.parametrize(("fault", "change"), EACH)
def test_a_view_that_cannot_be_one_changes_nothing_and_is_counted(fault, change):
    estimator = flown()
    good = view(4.95, np.zeros((2, LEVEL_STATES)), 2.0, 0.0)
    wrong = replace(good, **change)
    before, seen_at, innovation = estimator.estimate(5.0), estimator.seen_at, estimator.innovation
    assert fault_of(good, 5.0) is None
    assert fault_of(wrong, 5.0) is fault
    estimator.target_seen(wrong, 5.0)
    after = estimator.estimate(5.0)
    assert estimator.refused == {fault: 1}
    assert (estimator.seen_at, estimator.innovation) == (seen_at, innovation)
    assert np.array_equal(after.axes, before.axes)
    assert np.array_equal(after.vertical, before.vertical)
    assert after.yaw == before.yaw
    estimator.target_seen(good, 5.0)
    assert estimator.seen_at == 4.95


def test_no_estimate_begins_with_a_view_that_cannot_be_one():
    good = view(0.0, np.zeros((2, LEVEL_STATES)), 2.0, 0.0)
    with pytest.raises(ValueError, match="finite"):
        Estimator(MODEL, replace(good, at=math.nan), HOVER)


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        ((math.nan, 0.0, 0.0, 0.0), ViewFault.NOT_FINITE),
        ((5.0, math.nan, 0.0, 0.0), ViewFault.NOT_FINITE),
        ((5.0, 0.0, 0.0, math.inf), ViewFault.NOT_FINITE),
        ((5.0, 3.2, 0.0, 0.0), ViewFault.NO_ROTATION),
        ((5.0, 0.0, -3.2, 0.0), ViewFault.NO_ROTATION),
    ],
)
def test_an_attitude_that_is_none_changes_nothing(wrong, fault):
    estimator = flown()
    before = estimator.estimate(5.0)
    estimator.attitude_received(*wrong)
    assert np.array_equal(estimator.estimate(5.0).axes, before.axes)
    assert estimator.estimate(5.0).yaw == before.yaw
    assert estimator.refused == {fault: 1}


def test_an_image_just_ahead_of_our_clock_is_of_now_and_the_newest_image_never_gets_older():
    estimator = flown()
    ahead = view(5.0 + FUTURE, np.zeros((2, LEVEL_STATES)), 2.0, 0.0)
    estimator.target_seen(ahead, 5.0)
    assert estimator.seen_at == 5.0
    estimator.target_seen(view(4.5, np.zeros((2, LEVEL_STATES)), 2.0, 0.0), 5.0)
    assert estimator.seen_at == 5.0
    assert estimator.estimate(5.3).age == pytest.approx(0.3)


def test_an_image_older_than_the_filter_is_no_sight_of_the_target():
    estimator = Estimator(MODEL, view(5.0, np.zeros((2, LEVEL_STATES)), 2.0, 0.0), HOVER)
    estimator.target_seen(view(4.9, np.zeros((2, LEVEL_STATES)), 2.0, 1.0), 5.0)
    assert estimator.refused == {ViewFault.TOO_OLD: 1}
    assert estimator.estimate(5.0).yaw == 0.0


@pytest.mark.parametrize(
    ("first", "believed"), [(0.0, 60.0), (59.0, 60.0), (60.0, 60.0), (190.0, 190.0), (254.0, 190.0)]
)
def test_no_estimate_begins_with_a_hover_throttle_that_carries_nothing(first, believed):
    assert Estimator(MODEL, view(0.0, np.zeros((2, LEVEL_STATES)), 2.0, 0.0), first).hover_gas == believed


def test_a_camera_is_doubted_after_images_that_were_refused_one_after_the_other_and_by_most_cameras():
    cameras = Cameras(3)
    for name in ("down", "forward"):
        cameras.seen(name, 1.0)
    for is_refused in (True, True, False, True, True):
        cameras.judged("down", is_refused=is_refused)
    assert (cameras.doubts("down", 1.0), cameras.contradicting) == (False, ())
    cameras.judged("down", is_refused=True)
    assert cameras.contradicting == ("down",)
    assert not cameras.doubts("down", 1.0), "the other half agrees"
    cameras.seen("down", 1.6 + TOGETHER)
    assert not cameras.doubts("down", 1.6 + TOGETHER), "what the other camera showed of it is still known"


WILD = st.one_of(st.floats(-3.0, 3.0), st.sampled_from([math.nan, math.inf, -math.inf, 1e300]))
WAITS = st.sampled_from([0.0, 0.02, 0.1, 1.0, 30.0])
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("attitude"), WAITS, WILD, WILD, WILD),
        st.tuples(st.just("view"), WAITS, st.floats(-2.0, 2.0) | WILD, WILD, WILD, st.sampled_from([1e-4, 0.0, -1.0])),
        st.tuples(st.just("sent"), WAITS, st.integers(-127, 127), st.integers(0, 254), st.none() | st.floats(0, 254)),
    ),
    max_size=25,
)


@given(EVENTS)
def test_whatever_arrives_the_estimate_is_numbers_and_the_newest_image_neither_ages_nor_lies_ahead(events):
    estimator, now = Estimator(MODEL, view(0.0, np.zeros((2, LEVEL_STATES)), 2.0, 0.0), HOVER), 0.0
    for what, wait, *how in events:
        now += wait
        estimator.advance(now)
        before = estimator.seen_at
        match what:
            case "attitude":
                estimator.attitude_received(now - 0.02, *how)
            case "view":
                age, x, turn, variance = how
                rotation = np.eye(3) if turn != turn else np.diag([1.0, math.copysign(1.0, turn), 1.0])
                covariance = np.diag([1e-4] * 5 + [variance])
                estimator.target_seen(TargetView(now - age, np.array([x, 0.1, -2.0]), rotation, covariance), now)
            case "sent":
                pitch, gas, cap = how
                estimator.sent(StickCommand(now, pitch, -pitch, 0.0, gas, ThrottleUse(cap, is_ours=cap is None)))
                estimator.recentre_hover(0.02, gas)
        found = estimator.estimate(now + 0.029)
        assert before <= estimator.seen_at <= now
        assert math.isfinite(estimator.innovation)
        assert 60.0 <= estimator.hover_gas <= 190.0
        assert np.isfinite([*found.axes.flat, *found.vertical, *found.position_sd, found.yaw, found.age]).all()


@settings(max_examples=6, deadline=None)
@given(st.permutations(range(6)))
def test_the_order_in_which_late_images_arrive_changes_the_estimate_little(order):
    """Not at all but for the heading and the caution, which follow the images as they come; here caution is nothing."""
    ends = []
    plant, begun = _flown()
    views = []
    for k in range(6):
        axes = plant.axes.copy()
        axes[:, P] -= 0.03 * k * axes[:, V]  # where it was
        views.append(view(5.0 - 0.03 * k, axes, 2.0 + 0.001 * k, plant.yaw))
    for one in (range(6), order):
        estimator = deepcopy(begun)
        estimator._nominal = estimator._robust
        for k in one:
            estimator.target_seen(views[k], 5.0)
        ends.append(estimator.estimate(5.0))
    assert ends[0].position == pytest.approx(ends[1].position, abs=2e-3)
    assert ends[0].velocity == pytest.approx(ends[1].velocity, abs=1e-2)
