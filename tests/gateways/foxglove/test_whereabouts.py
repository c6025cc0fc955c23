"""Which source says where the aircraft is, and the tree of frames."""

from __future__ import annotations

import foxglove.messages as fg
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mkdaemon.client.place import HOME
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.gateways.foxglove.whereabouts import LOST, OLD, FrameTree, Poses, Whereabouts
from tests import samples
from tests.gateways.foxglove.viewer import read

ONE = Names("mk1")


def edges(frames, value):
    message = frames("", value)
    found = [] if message is None else read(fg.FrameTransforms.get_schema(), message)["transforms"]
    return {(edge["parent_frame_id"], edge["child_frame_id"]): edge for edge in found}


def matrix(edge):
    """Parent from child (4, 4)."""
    found = np.eye(4)
    found[:3, :3] = rotation_from_quaternion(tuple(edge["rotation"][axis] for axis in "wxyz"))
    found[:3, 3] = [edge["translation"][axis] for axis in "xyz"]
    return found


def test_the_flight_core_comes_before_a_camera_and_a_camera_before_gps_and_no_place_is_older_than_the_last():
    where = Whereabouts()
    assert where.take(samples.position(0.0)) is None  # level or not is not known yet
    assert where.take(samples.attitude(0.0)).source == "gps"
    assert where.take(samples.pose(1.0)).source == "pose"
    assert where.take(samples.position(1.1)) is None
    assert where.take(samples.estimate(2.0)).source == "estimate"
    assert where.take(samples.pose(2.0 + OLD)) is None
    assert where.take(samples.pose(2.1 + OLD)).source == "pose"
    assert where.take(samples.position(2.0 + OLD + LOST)) is None
    assert where.take(samples.position(2.2 + OLD + LOST)).frame == HOME
    where = Whereabouts()
    assert where.take(samples.estimate(5.0)) is not None
    assert where.take(samples.estimate(4.0)) is None
    assert where.place.at == 5.0


def test_the_target_is_the_root_or_home_and_map_the_same_frame():
    frames = FrameTree(ONE)
    frames("", samples.attitude(1.0, roll=0.1))
    found = edges(frames, samples.estimate(1.0))
    assert matrix(found["pad", "map"]) == pytest.approx(np.eye(4))
    body = matrix(found["map", "base_link"])
    assert body[:3, 3] == pytest.approx([0.12, -0.05, 2.01])
    assert body[:3, 0] @ [np.cos(0.5), np.sin(0.5), 0.0] > 0.99  # its nose points where the estimate's yaw says
    assert body[2, 1] == pytest.approx(np.sin(0.1) * np.cos(0.05))  # right side down: the left axis points up
    frames = FrameTree(Names("mk1", "mk1/"))
    assert set(edges(frames, samples.attitude(1.0))) == {("mk1/map", "mk1/base_link")}
    found = edges(frames, samples.position(1.1))
    assert set(found) == {("mk1/home", "mk1/map"), ("mk1/map", "mk1/base_link")}
    assert matrix(found["mk1/map", "mk1/base_link"])[:3, 3] == pytest.approx([1.0, 2.0, 3.0])
    assert edges(frames, samples.position(1.2, position_enu=None)) == {}


def test_a_camera_that_looks_down_sees_the_target_ahead_of_it():
    frames = FrameTree(ONE)
    mount = matrix(edges(frames, samples.setup(1.0))["base_link", "camera/down"])
    assert mount[:3, 2] == pytest.approx([0.0, 0.0, -1.0])  # forward of the camera is down
    assert mount[:3, 1] == pytest.approx([-1.0, 0.0, 0.0])  # down in its image is backward
    assert edges(frames, samples.setup(1.0, position_flu=None)) == {}


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 3), st.floats(0.0, 60.0)), max_size=30))
def test_whatever_comes_when_places_never_go_back(came):
    where, last = Whereabouts(), float("-inf")
    makes = (samples.estimate, samples.pose, samples.attitude, samples.position)
    for kind, at in came:
        place = where.take(makes[kind](at))
        if place is not None:
            assert place.at >= last
            last = place.at


def test_the_pose_is_told_in_the_frame_of_the_target():
    poses = Poses(ONE)
    assert poses("", samples.attitude(1.0)) is None
    found = read(fg.PoseInFrame.get_schema(), poses("", samples.estimate(1.0)))
    assert (found["frame_id"], found["pose"]["position"]["z"]) == ("pad", 2.01)
    assert found["timestamp"] == "2023-11-14T22:13:21Z"
