"""The simulated motion capture system: what it measures of the truth, and its faults."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.frames import rotation_from_euler
from mkdaemon.telemetry.sim_faults import MOCAP_KINDS
from mksim.physics.mocap import ANGLE_SD, DROP_OUT, FAULTS, LATENCY, PLACE_SD, MotionCapture


class Truth:
    position_enu = np.array([0.4, -0.3, 1.2])
    enu_from_flu = rotation_from_euler(0.05, -0.02, 0.6)


def measured(fault="", count=2000, seed=1):
    capture = MotionCapture(seed)
    capture.fault = fault
    return [capture.measure(0.01 * k, Truth()) for k in range(count)]


def test_it_measures_the_truth_with_its_noise_and_loses_the_body_now_and_then():
    found = measured()
    seen = [one for one in found if one is not None]
    assert 1.0 - len(seen) / len(found) == pytest.approx(DROP_OUT, abs=0.008)
    errors = np.array([one.position - Truth.position_enu for one in seen])
    assert np.abs(errors.mean(axis=0)).max() < 1e-4
    assert errors.std() == pytest.approx(PLACE_SD, rel=0.1)
    turned = np.array([(Truth.enu_from_flu.T @ one.rotation)[[2, 0, 1], [1, 2, 0]] for one in seen])
    assert turned.std() == pytest.approx(ANGLE_SD, rel=0.1)
    assert {(one.latency, one.stated) for one in seen} == {(LATENCY, LATENCY)}


def test_every_fault_can_be_asked_for_by_its_name():
    assert set(MOCAP_KINDS) == set(FAULTS)


def near(found, place):
    return [one is None or np.allclose(one.position, place, atol=0.01) for one in found]


def test_faults_do_what_their_names_say():
    x, y, z = Truth.position_enu
    assert all(near(measured("off", 50), (x + 0.3, y, z)))
    assert measured("silent", 50) == [None] * 50
    assert {(one.latency, one.stated) for one in measured("late", 50) if one} == {(0.5, 0.5)}
    assert {(one.latency, one.stated) for one in measured("late_unsaid", 50) if one} == {(0.5, 0.0)}
    for fault in ("mirrored", "mirrored_place"):
        assert all(near(measured(fault, 50), (x, -y, z)))
    assert all(np.linalg.det(one.rotation) == pytest.approx(1.0) for one in measured("mirrored", 50) if one)
    assert all(near(measured("wrong_up", 50), (x, -z, y)))
    assert not any(near(measured("other_body", 50), (x, y, z)))
    assert all(near(measured("neighbour", 50), (0.3, 0.2, 0.1)))
    assert len({tuple(one.position) for one in measured("frozen", 50) if one}) == 1
