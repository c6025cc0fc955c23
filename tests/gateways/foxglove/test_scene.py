"""Which source says where the aircraft is, the tree of frames, and what is in the scene."""

from __future__ import annotations

import foxglove.messages as fg
import numpy as np
import pytest

from mkdaemon.client.place import HOME
from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.gateways.foxglove.scene import VehicleScene, print_of
from mkdaemon.gateways.foxglove.whereabouts import LOST, OLD, FrameTree, Whereabouts
from tests import samples
from tests.gateways.foxglove.viewer import read


def update(scene, value):
    message = scene("", value)
    return {"entities": [], "deletions": []} if message is None else read(fg.SceneUpdate.get_schema(), message)


def entities(scene, value):
    return {one["id"]: one for one in update(scene, value)["entities"]}


@pytest.fixture
def scene():
    return VehicleScene(Names("mk1"))


def test_the_target_lies_where_its_file_says_and_a_later_tag_on_top(scene):
    target = entities(scene, samples.setup(1.0))["target"]
    assert (target["frame_id"], target["frame_locked"]) == ("pad", True)
    paper, black = (np.array([[p[axis] for axis in "xyz"] for p in part["points"]]) for part in target["triangles"])
    assert len(black) == 3 * 6  # three black cells of four, two triangles each
    assert black.min(0)[:2] == pytest.approx([-0.15, -0.15])
    assert black.max(0)[:2] == pytest.approx([0.15, 0.15])
    assert np.ptp(paper, axis=0)[0] == pytest.approx(0.6)  # a border of one cell
    assert black[:, 2].min() > paper[:, 2].max()
    # The white cell is the last of the last row: right and low on the print.
    centres = black.reshape(-1, 6, 3).mean(1)
    assert not any(x > 0 and y < 0 for x, y, _ in centres)
    (shape,) = samples.setup(1.0).targets
    low, high = print_of(shape.tags[0], 0.0), print_of(shape.tags[0], 0.001)
    heights = [{point["z"] for point in read(type(part).get_schema(), part.encode())["points"]} for part in low + high]
    assert max(heights[1]) < min(heights[2])


def test_a_goal_is_shown_for_as_long_as_it_is_told_and_the_fence_as_wide_and_high_as_it_is(scene):
    goal = entities(scene, samples.error(1.0))["goal"]
    assert goal["lifetime"] == "1s"
    assert goal["spheres"][0]["pose"]["position"] == {"x": 0.15, "y": -0.09, "z": 2.0}
    here, there = goal["lines"][0]["points"]
    assert here == pytest.approx({"x": 0.12, "y": -0.05, "z": 2.01})  # the estimate: goal and error
    assert there == {"x": 0.15, "y": -0.09, "z": 2.0}
    below, above, edges = entities(scene, samples.fence())["fence"]["lines"]
    assert {point["z"] for point in below["points"]} == {0.3}
    assert {point["z"] for point in above["points"]} == {6.0}
    assert {round(np.hypot(point["x"], point["y"]), 9) for point in above["points"]} == {5.0}
    assert (below["type"], edges["type"]) == ("LINE_LOOP", "LINE_LIST")


def test_where_no_target_is_seen_any_more_nothing_of_it_stays(scene):
    scene("", samples.setup(0.9))
    scene("", samples.attitude(1.0))
    scene("", samples.estimate(1.0))
    gone = update(scene, samples.position(7.0))
    assert {one["id"] for one in gone["deletions"]} == {"target", "path", "ellipse", "goal"}
    assert gone["entities"] == []
    back = update(scene, samples.estimate(8.0))
    assert {one["id"] for one in back["deletions"]} == {"target", "path", "ellipse", "goal"}
    assert {one["id"] for one in back["entities"]} == {"target", "ellipse"}


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
