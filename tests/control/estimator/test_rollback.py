"""Late and out-of-order measurements end in the same estimate as punctual ones."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.control.estimator.rollback import MEMORY, STEP, Measurement, RollbackFilter

F = np.array([[1.0, STEP], [0.0, 1.0]])
G = np.array([STEP * STEP / 2, STEP])
NOISE = np.diag([1e-8, 1e-5])
POSITION, SPEED = np.array([1.0, 0.0]), np.array([0.0, 1.0])


def make():
    return RollbackFilter(F, G, NOISE, np.array([[0.0, 1.0], [2.0, -1.0]]), np.diag([0.01, 0.01]), now=0.0)


def readings(rng, count=40):
    """Positions at moments, some inside a step."""
    out = []
    for _ in range(count):
        at = round(rng.uniform(0.05, 0.45), 4)
        out.append(Measurement(at, POSITION, np.array([at + rng.gauss(0, 0.02), 2 - at + rng.gauss(0, 0.02)]), 4e-4))
    return out


def run(measurements, delay):
    filter_ = make()
    queue = sorted(((m.at + delay(m), m) for m in measurements), key=lambda entry: entry[0])
    for step in range(60):
        now = step * STEP
        while queue and queue[0][0] <= now:
            filter_.measure(queue.pop(0)[1])
        filter_.advance(np.zeros(2))
    return filter_


def test_punctual_and_late_measurements_give_the_same_estimate():
    rng = random.Random(1)
    measurements = sorted(readings(rng), key=lambda m: m.at)
    punctual = run(measurements, lambda m: STEP)
    late = run(measurements, lambda m: 0.03 + rng.uniform(0, 0.1))
    assert np.allclose(punctual.states, late.states, atol=1e-9)
    assert np.allclose(punctual.covariances, late.covariances, atol=1e-12)


def test_inputs_are_remembered_through_a_rollback():
    filter_ = make()
    for step in range(30):
        filter_.advance(np.array([5.0, 0.0]) if step < 10 else np.zeros(2))
    assert filter_.states[0, 1] == pytest.approx(1.5)
    filter_.measure(Measurement(0.02, SPEED, np.array([1.1, -1.0]), 1e6))
    assert filter_.states[0, 1] == pytest.approx(1.5, abs=1e-6)


def test_looking_ahead_changes_nothing():
    filter_ = make()
    for _ in range(10):
        filter_.advance(np.zeros(2))
    before = filter_.states.copy()
    ahead = filter_.ahead(np.ones((5, 2)))
    assert np.array_equal(before, filter_.states)
    for _ in range(5):
        filter_.advance(np.ones(2))
    assert np.allclose(ahead, filter_.states)


def test_a_shift_of_the_reference_also_moves_the_past():
    shifted = make()
    for _ in range(20):
        shifted.advance(np.zeros(2))
    shifted.shift(0, np.array([3.0, 0.0]))
    shifted.measure(Measurement(0.1, POSITION, np.array([3.1, 1.9]), 1e-6))
    assert shifted.states[0, 0] == pytest.approx(3.0 + 0.2, abs=0.02)


def test_the_states_of_a_moment_are_those_of_its_step_or_the_nearest_known():
    filter_ = make()
    first = filter_.states.copy()
    for _ in range(10):
        filter_.advance(np.ones(2))
    assert np.array_equal(filter_.states_at(-1.0), first)
    assert np.array_equal(filter_.states_at(99.0), filter_.states)
    assert np.allclose(filter_.states_at(filter_.time - 3 * STEP), make_after(7).states)


def make_after(steps):
    """A filter after so many steps under an input of one."""
    filter_ = make()
    for _ in range(steps):
        filter_.advance(np.ones(2))
    return filter_


@pytest.mark.parametrize("steps", [1, 2, 7, 64, 1000])
def test_coasting_ends_where_single_steps_without_input_end_and_as_uncertain(steps):
    stepped, coasted = make(), make()
    for _ in range(steps):
        stepped.advance(np.zeros(2))
    coasted.coast(steps, 0.0)
    assert coasted.time == pytest.approx(stepped.time)
    assert np.allclose(coasted.states, stepped.states)
    assert np.allclose(coasted.covariances, stepped.covariances, rtol=1e-9)


def test_an_unknown_input_makes_a_coasting_filter_as_uncertain_as_it_may_have_moved():
    pushed, still, unknown = make(), make(), make()
    for _ in range(50):
        pushed.advance(np.full(2, 3.0))
        still.advance(np.zeros(2))
    unknown.coast(50, 3.0**2)
    moved = pushed.states - still.states
    grown = unknown.covariances - still.covariances
    assert np.allclose(grown, moved[:, :, None] * moved[:, None, :])


def test_after_coasting_nothing_older_is_remembered_and_shifts_are_kept():
    filter_ = make()
    for _ in range(20):
        filter_.advance(np.zeros(2))
    filter_.shift(1, np.array([1.0, 0.0]))
    filter_.measure(Measurement(0.1, POSITION, np.array([0.1, 1.9]), 1e-2))
    speed = filter_.states[0, 1]
    filter_.coast(100, 0.0)
    assert filter_.states[0, 1] == pytest.approx(speed)
    assert filter_.measure(Measurement(1.15, POSITION, np.zeros(2), 1.0)) is None
    assert filter_.measure(Measurement(1.205, POSITION, filter_.states[:, 0], 1.0)) is not None


MOMENTS = st.floats(0.35, 0.995)
VALUES = st.floats(-3.0, 3.0)
READINGS = st.lists(st.tuples(MOMENTS, VALUES, st.sampled_from([POSITION, SPEED]), st.floats(1e-4, 1.0)), max_size=8)


def after(readings, order):
    """A filter that was told readings in an order, at the end of a second."""
    filter_ = make()
    for step in range(100):
        filter_.advance(np.array([0.3, -0.1]) * (step % 7))
    for index in order:
        at, value, row, variance = readings[index]
        filter_.measure(Measurement(at, row, np.array([value, -value]), variance, gate=1e9))
    return filter_


@given(READINGS, st.randoms(use_true_random=False))
def test_the_order_in_which_late_measurements_arrive_does_not_matter(readings, rng):
    order = list(range(len(readings)))
    rng.shuffle(order)
    one, other = after(readings, range(len(readings))), after(readings, order)
    assert np.allclose(one.covariances, other.covariances, atol=1e-9)  # asked for first: the rollback waits for it
    assert np.allclose(one.states, other.states, atol=1e-7)


OTHER_VALUES = st.one_of(VALUES, st.sampled_from([np.nan, np.inf, -np.inf, 1e9]))
DEEDS = st.lists(
    st.one_of(
        st.tuples(st.just("advance"), st.integers(1, 120)),
        st.tuples(st.just("coast"), st.integers(1, 5000)),
        st.tuples(st.just("shift"), VALUES),
        st.tuples(st.just("doubt"), VALUES),
        st.tuples(st.just("measure"), st.floats(0.0, 1.2), OTHER_VALUES, st.sampled_from([1e-6, 1e-2, 1.0, 0.0, -1.0])),
    ),
    max_size=12,
)


@given(DEEDS)
def test_states_stay_numbers_and_covariances_symmetric_and_positive(deeds):
    filter_ = make()
    for deed, *how in deeds:
        match deed:
            case "advance":
                for _ in range(how[0]):
                    filter_.advance(np.ones(2))
            case "coast":
                filter_.coast(how[0], 0.04)
            case "shift":
                filter_.shift(1, np.full(2, how[0]))
            case "doubt":
                late = Measurement(filter_.time - 0.1, POSITION, np.full(2, how[0]), 1e-3)
                filter_.measure(late, np.diag([0.1, 0.1]))
            case "measure":
                back, value, variance = how
                filter_.measure(Measurement(filter_.time - back, SPEED, np.array([value, 0.0]), variance))
        covariances = filter_.covariances
        assert np.isfinite(filter_.states).all()
        assert np.allclose(covariances, covariances.transpose(0, 2, 1), rtol=1e-9, atol=1e-15)
        assert np.linalg.eigvalsh(covariances).min() > -1e-12 * np.abs(covariances).max()


@pytest.mark.parametrize(
    "wrong",
    [
        Measurement(np.nan, POSITION, np.zeros(2), 1.0),
        Measurement(0.1, POSITION, np.array([np.nan, 0.0]), 1.0),
        Measurement(0.1, np.array([np.inf, 0.0]), np.zeros(2), 1.0),
        Measurement(0.1, POSITION, np.zeros(2), 0.0),
        Measurement(0.1, POSITION, np.zeros(2), np.array([1.0, -1.0])),
        Measurement(0.1, POSITION, np.zeros(2), np.inf),
    ],
)
def test_what_is_no_measurement_is_refused_and_counted(wrong):
    filter_ = make_after(20)
    assert filter_.measure(wrong, np.eye(2)) is None
    assert (filter_.refused, filter_.dropped, filter_.rejected) == (1, 0, 0)
    assert np.array_equal(filter_.covariances, make_after(20).covariances)


@pytest.mark.parametrize(("deviations", "is_believed"), [(4.9, True), (-4.9, True), (5.1, False), (-5.1, False)])
def test_five_standard_deviations_are_believed_and_no_more(deviations, is_believed):
    filter_ = run(readings(random.Random(3)), lambda m: 0.02)
    spread = np.sqrt(filter_.covariances[0, 0, 0] + 4e-4)
    seen = filter_.states[:, 0] + np.array([deviations * spread, 0.0])
    filter_.measure(Measurement(filter_.time, POSITION, seen, 4e-4))
    assert (filter_.rejected == 0) is is_believed


def sure(steps=30, *, states=((0.0, 1.0),), noise=0.0):
    """A filter without inputs; place and speed are each known to 0.1."""
    filter_ = RollbackFilter(F, G, noise * np.eye(2), np.array(states), np.diag([0.01, 0.01]), now=0.0)
    for _ in range(steps):
        filter_.advance(np.zeros(len(states)))
    return filter_


@pytest.mark.parametrize("at", [0.0, 0.003, 0.25, 0.2575, 0.3, 5.0])
@pytest.mark.parametrize("off", [0.0, 0.04, -0.2])
def test_a_measurement_is_compared_with_the_state_of_its_very_moment_or_of_the_end_of_the_newest_step(at, off):
    stamped, at = at, min(at, 0.31)
    ratio = sure().measure(Measurement(stamped, POSITION, np.array([at + off]), 4e-4))
    assert ratio == pytest.approx(off / np.sqrt(0.01 + 0.01 * at**2 + 4e-4), abs=1e-9)


@pytest.mark.parametrize("at", [0.0, 0.1234, 0.3])
def test_a_measurement_makes_place_and_speed_as_sure_as_a_line_through_it(at):
    filter_ = sure()
    filter_.measure(Measurement(at, POSITION, np.array([at + 0.05]), 0.02))
    # Place and speed at the start, by least squares; 0.3 s later by the speed.
    row = np.array([1.0, at])
    information = np.eye(2) / 0.01 + np.outer(row, row) / 0.02
    start = np.linalg.solve(information, np.array([0.0, 1.0]) / 0.01 + row * (at + 0.05) / 0.02)
    later = np.array([[1.0, 0.3], [0.0, 1.0]])
    assert filter_.states[0] == pytest.approx(later @ start)
    assert filter_.covariances[0] == pytest.approx(later @ np.linalg.inv(information) @ later.T)


def test_noise_of_each_step_adds_up():
    assert sure(30, noise=1e-4).covariances[0, 1, 1] == pytest.approx(0.01 + 30e-4)
    changed = sure(10, noise=1e-4)
    changed.set_noise(4e-4 * np.eye(2))
    for _ in range(20):
        changed.advance(np.zeros(1))
    assert changed.covariances[0, 1, 1] == pytest.approx(0.01 + 10e-4 + 80e-4)


def test_doubt_widens_what_was_believed_before_the_measurement_is_weighed():
    filter_ = sure(0)
    filter_.measure(Measurement(0.0, POSITION, np.array([1.0]), 1.0), np.diag([0.99, 0.0]))
    assert filter_.states[0] == pytest.approx([0.5, 1.0])
    assert np.diag(filter_.covariances[0]) == pytest.approx([0.5, 0.01])


def test_a_measurement_that_is_only_asked_says_how_far_it_is_off_and_changes_nothing():
    filter_ = sure()
    before = filter_.states.copy(), filter_.covariances.copy()
    ratio = filter_.measure(Measurement(0.1, POSITION, np.array([0.3]), 1e-3, gate=0.0))
    assert ratio == pytest.approx(0.2 / np.sqrt(0.01 + 1e-4 + 1e-3))
    assert np.array_equal(filter_.states, before[0])
    assert np.array_equal(filter_.covariances, before[1])
    assert filter_.rejected == 1


def test_each_axis_is_rejected_for_itself():
    filter_ = sure(states=((0.0, 1.0), (2.0, -1.0)))
    filter_.measure(Measurement(0.3, POSITION, np.array([9.0, 1.72]), np.array([1e-4, 1e-2])))
    assert filter_.states[0] == pytest.approx([0.3, 1.0])
    assert 1.7 < filter_.states[1, 0] < 1.72
    assert filter_.rejected == 1


def test_other_dynamics_hold_from_now_on():
    filter_ = sure(10)
    filter_.set_dynamics(np.array([[1.0, 3.0 * STEP], [0.0, 1.0]]), 2.0 * G)
    for _ in range(10):
        filter_.advance(np.ones(1))
    speed = 1.0 + 10 * 2.0 * STEP
    assert filter_.states[0, 1] == pytest.approx(speed)
    assert filter_.states[0, 0] == pytest.approx(0.1 + 0.3 + 3.0 * 0.02 * 0.45 + 0.001)
    found = filter_.measure(Measurement(0.205, POSITION, filter_.states[:, 0] + 0.005 * 3.0 * speed, 1.0))
    assert found == pytest.approx(0.0, abs=1e-9), "inside a step it moves as it does now"


def test_just_the_memory_is_remembered():
    filter_ = sure(79)
    assert filter_.remembers(0.0)
    assert not filter_.remembers(-0.001)
    assert filter_.measure(Measurement(-0.001, POSITION, np.zeros(1), 1.0)) is None
    filter_.advance(np.zeros(1))
    assert [filter_.remembers(at) for at in (0.0099, 0.0101)] == [False, True]
    assert filter_.measure(Measurement(0.0101, POSITION, np.array([0.0101]), 1.0)) is not None
    assert (filter_.dropped, MEMORY, STEP) == (1, 0.8, 0.01)


def test_a_filter_that_begins_inside_a_step_begins_with_it():
    filter_ = RollbackFilter(F, G, NOISE, np.array([[0.0, 1.0]]), np.eye(2), now=7.019)
    assert filter_.time == pytest.approx(7.01)
    assert filter_.remembers(7.0101)
    assert not filter_.remembers(7.0099)


OTHER_F = np.array([[1.0, 3.0 * STEP], [0.0, 0.99]])


@pytest.mark.parametrize(
    "deed",
    [
        lambda filter_: filter_.advance(np.ones(2)),
        lambda filter_: filter_.set_noise(9.0 * NOISE),
        lambda filter_: filter_.set_dynamics(OTHER_F, 2.0 * G),
        lambda filter_: filter_.shift(1, np.array([0.5, -0.5])),
        lambda filter_: filter_.coast(7, 0.1),
        lambda filter_: filter_.ahead(np.ones((3, 2))),
    ],
)
@pytest.mark.parametrize("back", [0.0, 0.011, 0.1])
def test_what_is_done_after_a_late_measurement_is_done_to_what_it_says(deed, back):
    """Whether somebody looks in between or not."""
    looked, unlooked = make_after(20), make_after(20)
    for filter_ in (looked, unlooked):
        late = Measurement(filter_.time - back, POSITION, np.array([0.5, 1.5]), 1e-3)
        filter_.measure(late)
        if filter_ is looked:
            assert filter_.states.shape == filter_.covariances.shape[:2]
        deed(filter_)
        filter_.advance(np.ones(2))
    assert np.allclose(looked.states, unlooked.states, atol=1e-12)
    assert np.allclose(looked.covariances, unlooked.covariances, atol=1e-12)


def test_the_state_of_a_late_moment_knows_what_was_measured_before_it():
    filter_ = make_after(20)
    filter_.measure(Measurement(0.05, POSITION, np.array([0.5, 1.5]), 1e-6))
    at_once = filter_.states_at(0.1).copy()
    assert filter_.states.shape == (2, 2)
    assert np.array_equal(filter_.states_at(0.1), at_once)
    assert at_once[0, 0] > 0.4
