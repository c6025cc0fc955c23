"""Late and out-of-order measurements end in the same estimate as punctual ones."""

from __future__ import annotations

import random

import numpy as np
import pytest

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


def test_who_looks_after_every_measurement_sees_what_who_looks_at_the_end_sees():
    rng = random.Random(3)
    looked, unlooked = make(), make()
    for step in range(200):
        for filter_ in (looked, unlooked):
            filter_.advance(np.array([0.1, -0.2]))
            if step == 100:
                filter_.set_noise(2.0 * NOISE)
        for _ in range(3):
            at, value = (step + 1) * STEP - rng.uniform(0.0, 0.2), rng.gauss(0.0, 0.1)
            for filter_ in (looked, unlooked):
                filter_.measure(Measurement(at, POSITION, np.array([value, -value]), 4e-4))
            assert looked.states.shape == (2, 2)
    assert np.array_equal(looked.states, unlooked.states)
    assert np.array_equal(looked.covariances, unlooked.covariances)
    assert looked.rejected == unlooked.rejected


def test_the_estimate_follows_each_axis():
    filter_ = run(readings(random.Random(2), 200), lambda m: 0.05)
    assert np.allclose(filter_.states[:, 0], [filter_.time, 2 - filter_.time], atol=0.03)
    assert np.allclose(filter_.states[:, 1], [1, -1], atol=0.2)


def test_inputs_are_remembered_through_a_rollback():
    filter_ = make()
    for step in range(30):
        filter_.advance(np.array([5.0, 0.0]) if step < 10 else np.zeros(2))
    assert filter_.states[0, 1] == pytest.approx(1.5)
    filter_.measure(Measurement(0.02, SPEED, np.array([1.1, -1.0]), 1e6))
    assert filter_.states[0, 1] == pytest.approx(1.5, abs=1e-6)


def test_an_unbelievable_measurement_changes_nothing_and_is_counted():
    filter_ = run(readings(random.Random(3)), lambda m: 0.02)
    before = filter_.states.copy()
    ratio = filter_.measure(Measurement(filter_.time, POSITION, np.array([50.0, before[1, 0]]), 4e-4))
    assert abs(ratio[0]) > 5
    assert filter_.rejected == 1
    assert filter_.states[0] == pytest.approx(before[0])


def test_older_than_the_memory_is_dropped():
    filter_ = make()
    for _ in range(200):
        filter_.advance(np.zeros(2))
    assert filter_.measure(Measurement(2.0 - MEMORY - 0.05, POSITION, np.zeros(2), 1.0)) is None
    assert filter_.dropped == 1


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
    assert np.allclose(filter_.states_at(filter_.time - 3 * STEP), make_after(7))


def make_after(steps):
    """States after so many steps under an input of one."""
    filter_ = make()
    for _ in range(steps):
        filter_.advance(np.ones(2))
    return filter_.states


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
