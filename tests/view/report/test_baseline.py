"""A camera against a reference: each injected fault is found with its size, and what cannot be told is not told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.frames import rotation_from_euler
from mkdaemon.view.report.alignment import TagView, rotation_vectors, rotations_by
from mkdaemon.view.report.baseline import NO_IMAGE, NO_TAG, OUT_OF_SIGHT, Baseline, Images, NoAnswer, compare
from tests.view.report.compared import Wrong, only, tracks, truth, without

VIEW = TagView(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.array([0.2]), np.zeros(3), np.eye(3))
LOOKING_DOWN = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
QUIET = 0.2
"""What is not injected stays below this, shown in cm, deg or %; in ms ten times as much."""


def images_of(track):
    return Images(track.times, [""] * len(track.times), np.ones(len(track.times)))


def against(camera, reference, view=VIEW, images=None):
    found = compare(camera, reference, view, images or images_of(camera))
    assert isinstance(found, Baseline), found
    return found


def shown(found):
    """Offsets in the units that they are shown in."""
    return {one.quantity.name: one.quantity.factor * one.value for one in found.offsets}


@pytest.mark.parametrize(
    ("wrong", "injected"),
    [
        (Wrong(), {}),
        (Wrong(scale=1.02), {"position scale, less 1": 2.0}),
        (Wrong(scale=0.97), {"position scale, less 1": -3.0}),
        (Wrong(place=(0.03, 0.0, 0.0)), {"mounting, forward": 3.0}),
        (Wrong(place=(0.0, -0.04, 0.02)), {"mounting, left": -4.0, "mounting, up": 2.0}),
        (Wrong(turn=(0.02, 0.0, 0.0)), {"mounting, roll": math.degrees(0.02)}),
        (Wrong(turn=(0.0, -0.03, 0.0)), {"mounting, pitch": math.degrees(-0.03)}),
        (Wrong(frame=(0.05, 0.0, 0.0)), {"frame, x": 5.0}),
        (Wrong(frame=(3.0, -2.0, 0.1), heading=2.0), {"frame, x": 300.0, "frame, y": -200.0, "frame, z": 10.0}),
        (Wrong(lag=0.04), {"lag of the camera's stamps": 40.0}),
        (Wrong(lag=-0.3), {"lag of the camera's stamps": -300.0}),
        (Wrong(scale=1.01, place=(0.0, 0.03, 0.0), lag=0.1), {"position scale, less 1": 1.0, "mounting, left": 3.0}),
    ],
    ids=str,
)
def test_what_is_injected_is_found_with_its_size(wrong, injected):
    found = against(*tracks(wrong))
    values = shown(found)
    for one in found.offsets:
        name, expected = one.quantity.name, injected.get(one.quantity.name, 0.0)
        if name == "frame, turn about z":
            expected = math.degrees(wrong.heading)
        if one.quantity.unit == "ms":
            expected = 1000.0 * wrong.lag
        tolerance = 10.0 * QUIET if one.quantity.unit == "ms" else QUIET
        assert values[name] == pytest.approx(expected, abs=tolerance), name
        assert one.is_known, name
        assert one.is_found == (abs(expected) > one.quantity.finds * one.quantity.factor), name


def test_offsets_are_taken_out_and_a_scale_is_not():
    noise = against(*tracks())
    found = against(*tracks(Wrong(place=(0.1, 0.0, 0.0), frame=(0.0, 0.2, 0.0), turn=(0.0, 0.0, 0.1), lag=0.05)))
    assert np.median(found.raw.across) > 0.1
    assert np.median(found.errors.across) == pytest.approx(np.median(noise.errors.across), rel=0.1)
    assert np.median(np.abs(found.raw.rpy[:, 2])) == pytest.approx(math.degrees(0.1), abs=0.5)
    assert np.abs(found.errors.rpy).max() < 1.0
    scaled = against(*tracks(Wrong(scale=1.02)))
    for one in scaled.distances:
        assert one.scale is None or one.scale == pytest.approx(1.02, abs=0.002)
    far = scaled.distances[-1]
    assert far.along.median == pytest.approx(0.02 * 2.8, abs=0.01)


def test_an_error_that_grows_with_the_angle_is_in_its_classes():
    camera, reference = tracks()
    steep = np.degrees(np.arccos(camera.positions[:, 2] / np.linalg.norm(camera.positions, axis=1)))
    tilts = [rotation_from_euler(math.radians(2.0 if angle > 20.0 else 0.0), 0.0, 0.0) for angle in steep]
    found = against(replace(camera, rotations=camera.rotations @ np.array(tilts)), reference)
    by_low = {one.low: one for one in found.angles}
    assert by_low[0.0].turn.median < 0.4
    assert by_low[20.0].turn.median == pytest.approx(2.0, abs=0.2)


def test_nothing_is_interpolated_over_a_drop_out_of_the_reference():
    camera, reference = tracks()
    found = against(camera, without(reference, (10.0, 12.0), (20.0, 20.2)))
    compared = found.errors.times
    assert not ((compared > 10.05) & (compared < 11.95)).any()
    assert len(compared) == pytest.approx(len(camera.times) - 44, abs=6)
    assert np.abs(found.errors.along).max() < 0.02


def test_drop_outs_of_the_camera_have_their_lengths_and_reasons():
    camera, reference = tracks()
    pauses = {(5.0, 6.0): "ambiguous", (12.0, 12.3): NO_TAG, (20.0, 23.0): NO_IMAGE}
    reasons = {at: next((why for (a, b), why in pauses.items() if a <= at <= b), "") for at in camera.times}
    came = {at: why for at, why in reasons.items() if why != NO_IMAGE}
    images = Images(np.array(list(came)), list(came.values()), np.ones(len(came)))
    found = against(without(camera, *pauses), reference, images=images)
    assert [one.reason for one in found.drop_outs] == list(pauses.values())
    assert [one.length for one in found.drop_outs] == pytest.approx([1.05, 0.35, 3.05], abs=0.051)


def test_detection_counts_only_images_with_the_target_in_view():
    camera, reference = tracks()
    lens = np.array([425.0, 425.0, 319.5, 239.5, 640.0, 480.0])
    view = replace(VIEW, flu_from_cam=LOOKING_DOWN, lens=lens)
    poses = [truth(at) for at in camera.times]
    away = np.array([-place @ turn @ LOOKING_DOWN for place, turn in poses])
    u = np.abs(425.0 * away[:, 0] / away[:, 2]) + 85.0 / away[:, 2] < 319.5
    v = np.abs(425.0 * away[:, 1] / away[:, 2]) + 85.0 / away[:, 2] < 239.5
    inside = u & v
    assert 50 < (~inside).sum() < 700
    # Of what is in view, every fourth image has no pose; nothing out of view has one.
    outcomes = [("" if k % 4 else "bits") if seen else NO_TAG for k, seen in enumerate(inside)]
    posed = np.array([not one for one in outcomes])
    found = against(only(camera, posed), reference, view, Images(camera.times, outcomes, np.ones(len(outcomes))))
    images = sum(one.images for one in found.distances)
    assert images == pytest.approx(inside.sum(), rel=0.02)
    assert sum(one.posed for one in found.distances) / images == pytest.approx(0.75, abs=0.02)
    assert {one.reason for one in found.drop_outs if one.length > 0.3} == {OUT_OF_SIGHT}


def test_a_fisheye_sees_what_a_pinhole_does_not_and_of_many_tags_the_nearest_is_looked_at():
    lens = np.array([200.0, 200.0, 320.0, 240.0, 640.0, 480.0])
    place = np.array([[-2.0, 0.0, -0.5], [0.0, 0.0, 1.0]])
    for is_fisheye in (False, True):
        view = replace(VIEW, radii=np.array([0.01]), lens=lens, is_fisheye=is_fisheye)
        assert view.look(place, np.array([np.eye(3)] * 2))[3].tolist() == [is_fisheye, False]
    view = replace(VIEW, centres=np.array([[0.0, 0, 0], [4.0, 0, 1.0]]), normals=np.array([[0, 0, 1.0], [-1.0, 0, 0]]))
    view = replace(view, radii=np.array([0.2, 0.2]))
    away, tags, cosine, _ = view.look(np.array([[3.0, 0.0, 1.0]]), np.eye(3)[None])
    assert (away[0].tolist(), tags[0].tolist(), cosine[0]) == ([-1.0, 0.0, 0.0], [4.0, 0.0, 1.0], 1.0)


def still(track):
    place, turn = truth(3.0)
    noise = np.random.default_rng(3).normal(0.0, 0.002, track.positions.shape)
    turns = np.repeat(turn[None], len(track.times), axis=0)
    return replace(track, positions=place + noise, rotations=turns @ rotations_by(noise))


def test_a_reference_that_stands_still_tells_neither_lag_nor_scale_nor_mounting():
    camera, reference = tracks(seconds=10.0)
    found = against(still(camera), still(reference))
    assert found.is_still
    unknown = {one.quantity.group.name for one in found.offsets if not one.is_known}
    assert unknown >= {"lag", "position scale", "mounting"}
    assert not any(one.is_found for one in found.offsets)
    assert np.median(found.errors.across) < 0.01


def test_a_flight_without_turns_leaves_the_offset_to_the_frame():
    camera, reference = tracks(Wrong(frame=(0.05, 0.0, 0.0)))
    level = np.repeat(np.eye(3)[None], len(camera.times), axis=0)
    also_level = np.repeat(np.eye(3)[None], len(reference.times), axis=0)
    found = against(replace(camera, rotations=level), replace(reference, rotations=also_level))
    known = {one.quantity.name: one.is_known for one in found.offsets}
    assert not known["mounting, forward"]
    assert shown(found)["frame, x"] == pytest.approx(5.0, abs=0.3)
    assert not found.is_still


CAMERA, REFERENCE = tracks(seconds=10.0)


@pytest.mark.parametrize(
    ("camera", "reference", "told"),
    [
        (without(CAMERA, (1.0, 20.0)), REFERENCE, "The camera has 20 poses, and 50 are needed"),
        (CAMERA, without(REFERENCE, (0.5, 20.0)), "The reference has 17 poses, and 50 are needed"),
        (replace(CAMERA, times=CAMERA.times + 50.0), REFERENCE, "do not overlap in time: record both at once"),
        (without(CAMERA, (2.0, 8.0)), without(REFERENCE, (0.0, 1.9), (8.1, 11.0)), "fall between two of the reference"),
        (without(CAMERA, (0.0, 20.0)), REFERENCE, "The camera has 0 poses"),
    ],
)
def test_what_cannot_be_answered_is_said_with_a_remedy(camera, reference, told):
    found = compare(camera, reference, VIEW, images_of(camera))
    assert isinstance(found, NoAnswer)
    assert told in found.reason
    assert "record" in found.reason


def test_rotation_vectors_and_rotations_are_inverse():
    vectors = np.array([[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0.3, -0.2, 0.1], [0.0, 3.1, 0.0]])
    assert rotation_vectors(rotations_by(vectors)) == pytest.approx(vectors, abs=1e-9)
