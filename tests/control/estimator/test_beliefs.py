"""How much the estimator believes of what: against least squares in information form, and in closed form."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from mkdaemon.control.estimator.estimator import Estimator
from mkdaemon.control.estimator.model import (
    LEAK_COUNT,
    LEVEL_STATES,
    TH,
    US,
    AircraftModel,
    B,
    D,
    E,
    H,
    P,
    S,
    T,
    V,
    W,
    Z,
)
from mkdaemon.control.estimator.tuning import NOMINAL, ROBUST
from mkdaemon.control.estimator.values import StickCommand, TargetView
from tests.control.estimator.test_parts import level_view
from tests.control.estimator.test_values import turned

MODEL = AircraftModel()
HOVER = 125.0
STILL = replace(ROBUST, yaw_gain=0.0)
"""Images do not turn the compass."""


def covariance(seed, size):
    """Any covariance of a pose, with standard deviations of about `size` [m; rad]."""
    root = np.random.default_rng(seed).normal(size=(6, 6))
    return size**2 * (root @ root.T / 6.0 + 0.1 * np.eye(6))


def leaning_view(rotation, place, *, at=0.0, seed=0, size=0.02):
    r = turned(rotation)
    return TargetView(at, -r.T @ np.array(place), r, covariance(seed, size))


class LeastSquares:
    """What several measurements of one moment say together, one state after the other as sums of information."""

    def __init__(self, mean, spread):
        self.information = np.linalg.inv(spread)
        self.weighted = self.information @ mean

    def add(self, row, value, variance):
        self.information = self.information + np.outer(row, row) / variance
        self.weighted = self.weighted + row * value / variance

    @property
    def mean(self):
        return np.linalg.solve(self.information, self.weighted)

    @property
    def covariance(self):
        return np.linalg.inv(self.information)


def upright_of(tilt):
    """Rotation (3, 3) of an aircraft that leans by these tangents (2,), without turning."""
    angle, (x, y) = math.atan(np.hypot(*tilt)), tilt / max(np.hypot(*tilt), 1e-12)
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def at_once(views, tuning, velocity):
    """Both horizontal axes, the vertical one and the mean of the innovations after views of one moment.

    By docs/lab/control.md, "Estimator".
    """
    yaw = views[0].heading
    turn = turned((0.0, 0.0, yaw))
    place = -turn @ views[0].position_flu
    starts = np.zeros((2, LEVEL_STATES))
    starts[:, P], starts[:, V] = place[:2], velocity[:2]
    axes = [LeastSquares(start, tuning.first_covariance) for start in starts]
    upright = LeastSquares(np.array([place[2], velocity[2], 0.0, 0.0]), np.diag(tuning.first_upright_spread) ** 2)
    innovation = 1.0
    for view in views:
        seen, spread = turn @ view.position_flu, turn @ view.sight_covariance @ turn.T
        fastest = max(abs(axis.mean[V]) for axis in axes)
        up = view.target_from_flu[:, 2]
        squares, leant = [], np.array([axis.mean[T] for axis in axes])
        measured = leant * seen[2] - (upright_of(leant) @ seen)[:2]
        for k, axis in enumerate(axes):
            # The place is seen as if the aircraft were level: off by its tilt times the distance.
            variance = spread[k, k] + 0.0003**2 + (0.004 * fastest) ** 2
            row = np.eye(LEVEL_STATES)[P] + seen[2] * np.eye(LEVEL_STATES)[T]
            squares.append((measured[k] - row @ axis.mean) ** 2 / (row @ axis.covariance @ row + variance))
            axis.add(row, measured[k], variance)
            tilt = (view.covariance[3, 3] + view.covariance[4, 4]) / 2.0 + 0.001**2
            axis.add(np.eye(LEVEL_STATES)[T], up[k] / up[2], tilt)
        innovation += 0.02 * (sum(squares) / 2.0 - innovation)
        normal = np.array([-axes[0].mean[T], -axes[1].mean[T], 1.0])
        normal /= np.linalg.norm(normal)
        leaning = sum(seen[k] ** 2 * axes[k].covariance[T, T] for k in (0, 1))
        upright.add(np.eye(4)[H], -normal @ seen, normal @ spread @ normal + 0.002**2 + leaning)
    return axes, upright, innovation


PLACE = (0.5, -0.8, 2.0)


@pytest.mark.parametrize("size", [0.005, 0.03])
@pytest.mark.parametrize("yaw", [0.0, 0.9, -2.5])
def test_views_of_one_moment_count_as_least_squares_say(size, yaw):
    velocity = np.array([1.5, -0.4, 0.3])
    views = [
        leaning_view((0.05, -0.08, yaw), PLACE, seed=1, size=size),
        leaning_view((0.04, -0.07, yaw), (0.505, -0.795, 2.005), seed=2, size=size),
        leaning_view((0.055, -0.09, yaw), (0.495, -0.8, 1.995), seed=3, size=size),
    ]
    estimator = Estimator(MODEL, views[0], HOVER, compass=0.3, velocity=velocity, robust=STILL)
    for view in views[1:]:
        estimator.target_seen(view, 0.0)
    axes, upright, innovation = at_once(views, STILL, velocity)
    found = estimator.estimate(0.0)
    assert found.axes == pytest.approx(np.array([axis.mean for axis in axes]), abs=1e-6)
    assert found.vertical == pytest.approx(upright.mean, abs=1e-6)
    assert found.position == pytest.approx([axes[0].mean[P], axes[1].mean[P], upright.mean[H]], abs=1e-6)
    assert found.velocity == pytest.approx([axes[0].mean[V], axes[1].mean[V], upright.mean[S]], abs=1e-6)
    spread = estimator.motion_covariance
    for k, axis in enumerate(axes):
        assert spread[k] == pytest.approx([axis.covariance[P, P], axis.covariance[P, V], axis.covariance[V, V]])
        assert found.position_sd[k] ** 2 == pytest.approx(axis.covariance[P, P])
    assert spread[2] == pytest.approx([upright.covariance[H, H], upright.covariance[H, S], upright.covariance[S, S]])
    assert found.position_sd[2] ** 2 == pytest.approx(upright.covariance[H, H])
    assert estimator.velocity_sd**2 == pytest.approx(max(axis.covariance[V, V] for axis in axes))
    assert estimator.innovation == pytest.approx(innovation)
    assert estimator.rejected == 0


def test_an_attitude_counts_by_its_own_variance_and_is_that_of_the_boards():
    view = leaning_view((0.0, 0.0, 0.7), PLACE, seed=4)
    estimator = Estimator(MODEL, view, HOVER, robust=STILL)
    estimator.attitude_received(0.0, 0.03, -0.02, 0.0)
    axes, _, _ = at_once([view], STILL, np.zeros(3))
    c, s = math.cos(0.7), math.sin(0.7)
    for axis, value in zip(axes, (0.03 * c - 0.02 * s, 0.03 * s + 0.02 * c), strict=True):
        axis.add(np.eye(LEVEL_STATES)[TH], value, 0.004**2)
    assert estimator.estimate(0.0).axes == pytest.approx(np.array([axis.mean for axis in axes]), abs=1e-6)


def tilt_sd(seen):
    """How well one image makes the tilt known [rad]."""
    return float(np.sqrt(Estimator(MODEL, seen, HOVER)._level.covariances[0, T, T]))


def sure_of_tilt(sd, rotation=(0.0, 0.0, 0.0)):
    """A view that knows the tilt so well and the place hardly at all."""
    seen = leaning_view(rotation, (0.0, 0.0, 2.0))
    return replace(seen, covariance=np.diag([100.0] * 3 + [sd**2] * 3))


@pytest.mark.parametrize(
    ("sd", "lean_deg", "is_used"),
    [
        (0.20, 0.0, True),
        (0.249, 0.0, True),
        (0.251, 0.0, False),
        (0.5, 0.0, False),
        (0.01, 50.0, True),
        (0.01, 59.5, True),
        (0.01, 60.5, False),
        (0.01, 120.0, False),
    ],
)
def test_a_tilt_less_certain_than_a_quarter_of_a_radian_or_beyond_sixty_degrees_is_not_used(sd, lean_deg, is_used):
    assert (tilt_sd(sure_of_tilt(sd, (math.radians(lean_deg), 0.0, 0.0))) < 0.1499) is is_used


def sd(matrix, *places):
    """Standard deviation of a state, or of the difference of two."""
    row = np.zeros(len(matrix))
    row[list(places)] = (1.0, -1.0)[: len(places)]
    return math.sqrt(row @ matrix @ row)


def test_before_the_first_image_the_boards_tilt_is_near_the_true_one_and_the_stick_near_that():
    first = ROBUST.first_covariance
    assert [sd(first, each) for each in (P, V, T, Z, W, D, B)] == pytest.approx([0.6, 0.5, 0.15, 0.03, 0.2, 1.0, 0.02])
    assert sd(first, TH, T) == pytest.approx(0.04)
    assert sd(first, US, TH) == pytest.approx(0.06)
    assert first[P, T] == first[V, T] == first[W, T] == 0.0
    assert ROBUST.first_upright_spread == pytest.approx([0.05, 0.2, 0.05, 1.5])


def test_a_filter_that_doubts_itself_is_as_unsure_of_place_and_wind_as_half_a_metre_and_more():
    level, upright = ROBUST.doubt, ROBUST.upright_doubt
    assert np.sqrt(np.diag(level)) == pytest.approx([0.3, 0.5, 0.05, 0.03, 0.02, 0.3, 0.03, 0.5, 0.01])
    assert np.sqrt(np.diag(upright)) == pytest.approx([0.5, 0.7, 0.1, 1.5])
    assert np.count_nonzero(level) == LEVEL_STATES
    assert np.count_nonzero(upright) == 4


def test_noise_grows_with_the_root_of_time_and_each_state_has_its_own():
    for tuning, rates, upright in (
        (NOMINAL, [0.0, 0.023, 0.0003, 0.0013, 0.001, 0.058, 0.0127, 0.076, 0.0005], [0.0, 0.0046, 0.004, 0.04]),
        (ROBUST, [0.0, 0.05, 0.03, 0.015, 0.001, 1.0, 0.05, 0.3, 0.0005], [0.0, 0.01, 0.004, 0.08]),
    ):
        assert np.sqrt(np.diag(tuning.level_noise(0.04))) == pytest.approx(0.2 * np.array(rates))
        assert np.count_nonzero(tuning.level_noise(0.04)) == LEVEL_STATES - 1
        assert np.sqrt(np.diag(tuning.upright_noise(0.04))) == pytest.approx(upright)


def watched(*, model=MODEL, nominal=NOMINAL, robust=ROBUST):
    """An estimator that has seen one image of an aircraft at rest."""
    return Estimator(model, level_view(), HOVER, nominal=nominal, robust=robust)


def see(estimator, at, off=0.0):
    """An image that shows the aircraft beside where it is [s; m]."""
    estimator.advance(at)
    estimator.target_seen(level_view(at, place=(off, 0.0, 2.0)), at)


def see_many(estimator, start, images, off=0.0, step=0.125):
    """Images that all show it as much beside where it is."""
    for k in range(1, images + 1):
        see(estimator, start + k * step, off)


@pytest.fixture
def estimator():
    return watched()


def test_the_mean_of_the_innovations_follows_an_image_by_a_fiftieth_and_none_counts_more_than_five_deviations(
    estimator,
):
    for k in range(1, 10):
        see(estimator, 0.125 * k)
        assert estimator.innovation == pytest.approx(0.98 ** (k + 1), abs=1e-6)
    before = estimator.innovation
    see(estimator, 1.25, off=4.0)
    assert estimator.innovation == pytest.approx(0.98 * before + 0.02 * 25.0)


def test_an_image_as_expected_leaves_the_caution_and_one_without_surprise_lowers_it_by_a_three_hundredth(estimator):
    before = estimator.caution
    see_many(estimator, 0.0, 40)
    assert estimator.caution == pytest.approx(before - 40 * 0.0033, abs=1e-6)
    estimator._judge(1.0)
    assert estimator.caution == pytest.approx(before - 40 * 0.0033, abs=1e-6)


def test_an_image_of_five_deviations_and_more_raises_it_by_a_twelfth_of_the_way(estimator):
    estimator.caution = 0.5
    see(estimator, 0.125, off=9.0)
    assert estimator.caution == pytest.approx(0.5 + 0.0033 * 24.0)


@pytest.mark.parametrize(("size", "end"), [(0.0, 0.0), (25.0, 1.0)])
def test_caution_stays_between_the_tuned_model_and_none(estimator, size, end):
    for _ in range(310):
        estimator._judge(size)
    assert estimator.caution == end


def test_beliefs_between_two_go_by_the_ratio_of_their_noises():
    middle = NOMINAL.towards(ROBUST, 0.5)
    assert middle.rate == pytest.approx(math.sqrt(NOMINAL.rate * ROBUST.rate))
    assert middle.view_floor == NOMINAL.view_floor
    assert NOMINAL.towards(ROBUST, 0.0) == NOMINAL
    assert astuple(NOMINAL.towards(ROBUST, 1.0)) == pytest.approx(astuple(ROBUST))


def test_beliefs_change_in_both_filters_with_the_caution():
    """Here the model that agrees is believed less, so that it shows."""
    unsure = replace(ROBUST, velocity=2.0, climb=3.0)
    one, other = watched(nominal=unsure), watched()
    one.caution = 0.0
    for estimator in (one, other):
        see(estimator, 0.125)
        estimator.advance(0.625)
    assert one.velocity_sd > 2.0 * other.velocity_sd
    assert one.motion_covariance[2, 2] > 2.0 * other.motion_covariance[2, 2]
    one.caution = 1.0
    see(one, 0.75)
    before = one._level.covariances[0, V, V]
    one.advance(0.85)
    assert one._level.covariances[0, V, V] - before < 0.1 * 2.0**2 / 4.0, "it grows by the other noise again"


def turned_by(second, *, first=0.5, sd=1e-6, tuning=ROBUST):
    """How far an image of another heading turns the estimate [rad]."""
    spread = np.diag([1e-6] * 5 + [sd**2])
    estimator = Estimator(MODEL, level_view(yaw=first), HOVER, compass=0.2, robust=tuning)
    estimator.target_seen(level_view(yaw=second, covariance=spread), 0.0)
    return math.remainder(estimator.estimate(0.0).yaw - first, math.tau)


def test_an_image_turns_the_compass_by_a_fifth_and_by_less_where_it_is_less_sure():
    assert turned_by(0.6) == pytest.approx(0.2 * 0.1, rel=1e-3)
    # The floor is 0.02 rad: with three of its variances more, a quarter counts.
    assert turned_by(0.6, sd=math.sqrt(3.0) * 0.02) == pytest.approx(0.05 * 0.1, rel=1e-3)
    assert turned_by(-3.1, first=3.1) == pytest.approx(0.2 * (math.tau - 6.2), rel=1e-3)
    assert turned_by(0.6, tuning=replace(ROBUST, yaw_gain=7.0)) == pytest.approx(0.1)


def test_a_late_image_is_compared_with_the_heading_of_its_moment():
    estimator = Estimator(MODEL, level_view(), HOVER, compass=1.0)
    for k in range(1, 70):
        estimator.attitude_received(0.01 * k, 0.0, 0.0, 1.0 + 0.01 * k)
    before = estimator.estimate(0.69).yaw
    for at in (0.1, 0.35, 0.6):
        estimator.target_seen(level_view(at, yaw=at), 0.69)
    assert estimator.estimate(0.69).yaw == pytest.approx(before, abs=0.01)
    assert before == pytest.approx(0.69, abs=0.011)


def test_headings_are_remembered_for_as_long_as_an_image_may_be_late():
    estimator = Estimator(MODEL, level_view(), HOVER)
    for k in range(1, 400):
        estimator.attitude_received(0.01 * k, 0.0, 0.0, 0.01 * k)
    oldest = estimator._headings[0][0]
    assert oldest == pytest.approx(2.99, abs=0.011)
    assert estimator._heading_at(3.5) == pytest.approx(math.remainder(3.5, math.tau))
    assert estimator._heading_at(0.0) == pytest.approx(oldest)


def climbed(seconds, *, throttle, wind=0.0):
    """Height and speed under a throttle over hover, by small steps of the equations."""
    step, height, speed, force = 1e-4, 2.0, 0.0, 0.0
    for k in range(round(seconds / step)):
        asked = throttle**2 - 1.0 if k * step >= 0.03 else 0.0
        height, speed, force = (
            height + step * speed,
            speed + step * (9.81 * force + wind - 0.35 * speed),
            force + step * (asked - force) / 0.06,
        )
    return height, speed


@pytest.mark.parametrize("throttle", [0.9, 1.1, 1.2])
def test_a_throttle_lifts_as_its_square_over_hover(throttle):
    estimator = Estimator(replace(MODEL, uplink=0.03), level_view(), HOVER)
    estimator.sent(StickCommand(0.0, 0.0, 0.0, 0.0, throttle * HOVER))
    found = estimator.estimate(0.5)
    height, speed = climbed(0.5, throttle=throttle)
    assert found.vertical[H] == pytest.approx(height, abs=2e-3)
    assert found.vertical[S] == pytest.approx(speed, abs=5e-3)


@pytest.mark.parametrize(("silent", "is_asked"), [(0.29, True), (0.31, False)])
def test_a_stick_frame_is_what_is_asked_for_until_nobody_has_sent_for_a_third_of_a_second(silent, is_asked):
    estimator = Estimator(MODEL, level_view(), HOVER)
    estimator.sent(StickCommand(0.0, 20.0, 0.0, 0.0, HOVER))
    estimator.attitude_received(silent, 0.01, -0.02, 0.0)
    asked = estimator._commands.at(silent)
    wanted = (20.0 * MODEL.rad_per_count, 0.0) if is_asked else (0.01, 0.02)
    assert asked.tilt == pytest.approx(wanted)
    assert asked.thrust == pytest.approx(0.0)


@pytest.mark.parametrize(("excess", "counted"), [(-0.5, -0.5), (0.5, 0.5), (-9.0, -0.2 * 9.81), (9.0, 0.2 * 9.81)])
def test_a_share_of_what_lifts_unexplained_moves_into_the_hover_throttle(excess, counted):
    estimator = Estimator(MODEL, level_view(), HOVER)
    estimator.sent(StickCommand(0.0, 0.0, 0.0, 0.0, HOVER))
    estimator._vertical.shift(E, np.array([excess]))
    estimator.recentre_hover(0.02, HOVER)
    # Thrust goes with the square of throttle: half of the share that lifts too much.
    share = -0.02 * counted / 9.81
    assert estimator.hover_gas == pytest.approx(HOVER * (1.0 + share / 2.0))
    assert estimator._vertical.states[0, E] == pytest.approx(excess + share * 9.81)


@pytest.mark.parametrize(("hover", "excess"), [(190.0, -0.5), (60.0, 0.5)])
def test_at_the_end_of_what_is_believed_nothing_moves(hover, excess):
    estimator = Estimator(MODEL, level_view(), hover)
    estimator.sent(StickCommand(0.0, 0.0, 0.0, 0.0, hover))
    estimator._vertical.shift(E, np.array([excess]))
    estimator.recentre_hover(0.02, hover)
    assert (estimator.hover_gas, estimator._vertical.states[0, E]) == (hover, pytest.approx(excess))


def looked_ahead_and_gone(*, is_known):
    """What is estimated of half a second later from afar and there; known is a state without doubt and noise."""
    looked, gone = (Estimator(MODEL, level_view(yaw=0.4), HOVER) for _ in range(2))
    for estimator in (looked, gone):
        if is_known:
            estimator._level._slots[-1].covariance = np.zeros((2, LEVEL_STATES, LEVEL_STATES))
            estimator._level.set_noise(np.zeros((LEVEL_STATES, LEVEL_STATES)))
        for k in range(20):
            estimator.sent(StickCommand(0.023 * k, 3.0 * k, -20.0, 0.0, HOVER + k))
    gone.advance(0.5)
    return looked.estimate(0.5), gone.estimate(0.5)


def test_who_goes_to_a_moment_finds_what_who_looked_ahead_found(monkeypatch):
    """The doubt that grows on the way blurs the counts of the leak: without it both are the same."""
    monkeypatch.setattr("mkdaemon.control.estimator.estimator.LOST", 0.0)
    ahead, there = looked_ahead_and_gone(is_known=True)
    assert there.axes == pytest.approx(ahead.axes, abs=1e-9)
    assert there.vertical == pytest.approx(ahead.vertical, abs=1e-9)
    assert np.abs(there.tilt).min() > 0.02


def test_what_leaks_on_the_way_differs_by_less_than_half_a_count():
    """Truncation takes half a count of any larger one, and none of one that is as likely negative."""
    ahead, there = looked_ahead_and_gone(is_known=False)
    difference = np.abs(there.axes - ahead.axes)
    assert 0.0 < difference[:, [T, TH]].max() < 0.5 * LEAK_COUNT * 0.5
    assert difference[:, V].max() < 9.81 * 0.5 * LEAK_COUNT * 0.5**2 / 2.0
    assert there.vertical == pytest.approx(ahead.vertical, abs=1e-9)


@pytest.mark.parametrize(("silent", "caution"), [(0.805, 0.0), (0.815, 1.0)])
def test_only_a_silence_longer_than_the_memory_ends_what_is_believed(estimator, silent, caution):
    estimator.caution = 0.0
    estimator.advance(silent)
    assert estimator.caution == caution


def test_a_silence_adds_what_half_of_the_largest_tilt_and_three_tenths_of_the_weight_would_do(monkeypatch):
    """Ahead of the memory of 0.8 s, for a second: 100 steps at once, the rest one by one.

    Without a leak, whose mean slope depends on how much is known: all is linear then.
    """
    model = replace(MODEL, leak=1e9)

    def silent():
        estimator = watched(model=model)
        estimator.advance(1.805)
        return estimator._level.covariances[0], estimator._vertical.covariances[0]

    unknown = silent()
    for name in ("UNKNOWN_TILT", "UNKNOWN_THRUST"):
        monkeypatch.setattr(f"mkdaemon.control.estimator.estimator.{name}", 0.0)
    known = silent()
    for dynamics, size, one, other in zip(
        (model.horizontal, model.vertical), (0.175, 0.3), unknown, known, strict=True
    ):
        moved = dynamics(0.8)[0] @ dynamics(1.0)[1] * size
        assert one - other == pytest.approx(np.outer(moved, moved), rel=1e-6, abs=1e-9)


def test_in_a_silence_all_leaks_and_not_whole_counts():
    """Nobody knows the state to a count then: a tilt of two thirds of one decays as the linear leak has it."""
    level = watched()._level
    level.shift(TH, 0.67 * LEAK_COUNT * MODEL.leak - level.states[:, TH])
    before = level.states
    level.coast(100, 0.0)
    assert level.states == pytest.approx(before @ MODEL.horizontal(1.0)[0].T, rel=0.02, abs=1e-5)
    assert np.abs(level.states[:, T] - before[:, T]).min() > 1e-3


@pytest.mark.parametrize("off", [0.001, 0.02])
def test_a_camera_that_contradicts_another_is_not_believed_even_where_it_agrees(estimator, off):
    for camera in ("", "forward"):
        estimator.target_seen(replace(level_view(), camera=camera), 0.0)
    for _ in range(3):
        estimator._cameras.judged("forward", is_refused=True)
    assert estimator.contradicting == ("forward",)
    before, rejected, yaw = estimator.estimate(0.0), estimator.rejected, estimator.estimate(0.0).yaw
    innovation = estimator.innovation
    estimator.target_seen(replace(level_view(place=(off, off, 2.0 + off), yaw=0.3), camera="forward"), 0.0)
    after = estimator.estimate(0.0)
    assert np.array_equal(after.axes, before.axes)
    assert np.array_equal(after.vertical, before.vertical)
    assert (after.yaw, estimator.innovation) == (yaw, innovation)
    assert estimator.rejected > rejected, "it is asked, and told that it is off"


def test_after_the_filter_of_the_sticks_changed_the_next_image_is_right():
    for is_changed in (False, True):
        estimator = watched()
        see_many(estimator, 0.0, 16)
        estimator._response.has_other_filter = is_changed
        for at in (2.0, 2.01, 2.02):
            estimator.attitude_received(at, 0.0, 0.0, 0.0)
            assert estimator.model == (MODEL.with_other_filter() if is_changed else MODEL), "once"
        see(estimator, 2.125, off=1.0)
        assert estimator.estimate(2.125).position[0] == pytest.approx(1.0 if is_changed else 0.0, abs=0.05)


@pytest.mark.parametrize("images", [1, 2, 3, 4])
def test_the_fourth_of_images_that_are_refused_is_right(estimator, images):
    see_many(estimator, 0.0, 16)
    for k in range(images):
        see(estimator, 2.125 + 0.125 * k, off=1.0)
    found = estimator.estimate(2.0 + 0.125 * images).position[0]
    assert found == pytest.approx(1.0 if images == 4 else 0.0, abs=0.05)


def test_sticks_ask_for_as_much_more_tilt_as_the_aircraft_was_found_to_give(estimator):
    estimator._response.measured, estimator._response._first_at = 1.5, -9.0
    assert estimator.stick_gain == 1.0, "it explains no more than the model's"
    estimator._response._is_clear = True
    assert estimator.stick_gain == 1.5
    estimator.sent(StickCommand(0.0, 20.0, -10.0, 0.0, HOVER))
    count = MODEL.rad_per_count
    assert estimator._commands.at(0.1).tilt == pytest.approx((1.5 * 20.0 * count, 1.5 * 10.0 * count))
    assert estimator._response._commands[-1][1] == pytest.approx([20.0 * count, -10.0 * count]), "it finds the factor"


def calibrated(view, sds):
    """The view by a camera whose calibration is so unsure, its covariance grown by that."""
    along, across, angle = sds
    grown = np.diag([across**2, across**2, along**2, angle**2, angle**2, angle**2])
    return replace(view, covariance=view.covariance + grown, calibration_sd=sds)


def test_what_a_calibration_does_not_know_does_not_average_out():
    """A hundred images of one camera know the place no better than its calibration, and do not weigh less for it."""
    sds, level = (0.006, 0.004, 0.0), (0.0, 0.0, 0.0)
    seen = [replace(leaning_view(level, (0.0, 0.0, 2.0)), at=0.03 * k, covariance=1e-6 * np.eye(6)) for k in range(100)]
    unsure, exact = (Estimator(MODEL, first, HOVER) for first in (calibrated(seen[0], sds), seen[0]))
    for view in seen[1:]:
        for estimator, shown in ((unsure, calibrated(view, sds)), (exact, view)):
            estimator.advance(view.at)
            estimator.target_seen(shown, view.at)
    assert unsure.estimate(3.0).axes == pytest.approx(exact.estimate(3.0).axes, abs=1e-9)
    added = unsure.estimate(3.0).position_sd ** 2 - exact.estimate(3.0).position_sd ** 2
    assert np.sqrt(added) == pytest.approx([0.004, 0.004, 0.006], rel=1e-3)
    assert unsure.motion_covariance[:, 0] == pytest.approx(unsure.estimate(3.0).position_sd ** 2)


def test_cameras_whose_calibrations_differ_as_they_may_are_both_believed():
    sds = (0.006, 0.004, 0.0)
    first = calibrated(replace(leaning_view((0.0, 0.0, 0.0), (0.0, 0.0, 2.0)), covariance=1e-6 * np.eye(6)), sds)
    other = replace(leaning_view((0.0, 0.0, 0.0), (0.0, 0.0, 2.03)), covariance=1e-6 * np.eye(6), camera="forward")
    for shown, refused in ((calibrated(other, sds), 0), (other, 1)):
        estimator = Estimator(MODEL, first, HOVER)
        for k in range(1, 100):
            estimator.advance(0.03 * k)
            estimator.target_seen(replace(first, at=0.03 * k), 0.03 * k)
        estimator.target_seen(replace(shown, at=2.97), 2.97)
        assert min(estimator.rejected, 1) == refused
