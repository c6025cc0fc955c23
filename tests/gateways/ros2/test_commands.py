"""What ROS sends to fly."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.errors import MkError
from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from mkdaemon.gateways.ros2 import commands
from mkdaemon.gateways.ros2.commands import AXES, BUTTONS
from mkdaemon.gateways.ros2.messages import Frames, pose
from tests.gateways.ros2.bagtypes import BagTypes

TYPES = BagTypes()
finite = st.floats(-20, 20)


def joy(axes=(0.0,) * 8, buttons=(0,) * 11):
    return SimpleNamespace(axes=list(axes), buttons=list(buttons))


@pytest.mark.parametrize("wrong", [joy(axes=(0.0,) * 4), joy(buttons=(0,) * 4), joy(axes=(math.nan,) * 8)])
def test_another_pad_is_refused(wrong):
    with pytest.raises(MkError):
        commands.pad_state(wrong, AXES, BUTTONS)


def at_time(at):
    """A header of a time [s]."""
    return SimpleNamespace(stamp=SimpleNamespace(sec=int(at), nanosec=round(at % 1.0 * 1e9)))


def ros_path(*poses):
    """A path by place, stamp [s] and orientation (w, x, y, z)."""
    return SimpleNamespace(
        poses=[SimpleNamespace(header=at_time(at), pose=pose(TYPES, place, wxyz)) for place, at, wxyz in poses]
    )


STILL, TURNED = (0.0, 0.0, 0.0, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def test_a_path_has_the_times_of_its_stamps_or_a_speed():
    timed = ros_path(((0.0, 0.0, 2.0), 5.0, STILL), ((1.0, 0.0, 2.0), 7.5, STILL), ((1.0, 1.0, 2.0), 8.0, STILL))
    points = commands.path_request(timed, 0.5).points
    assert [(point.position, point.time, point.speed, point.yaw) for point in points] == [
        ((0.0, 0.0, 2.0), None, None, None),
        ((1.0, 0.0, 2.0), 2.5, None, None),
        ((1.0, 1.0, 2.0), 0.5, None, None),
    ]
    plain = ros_path(((0.0, 0.0, 2.0), 0.0, TURNED), ((1.0, 0.0, 2.0), 0.0, TURNED))
    points = commands.path_request(plain, 0.4).points
    assert [(point.time, point.speed) for point in points] == [(None, None), (None, 0.4)]
    assert points[0].yaw == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("poses", "words"),
    [
        ([], "path: give points or pieces"),
        ([((0.0, 0.0, 2.0), 0.0, STILL)], "path: give at least two points"),
        ([((0.0, 0.0, 2.0), 0.0, STILL), ((math.nan, 0.0, 2.0), 0.0, STILL)], "path: position.0: "),
        ([((0.0, 0.0, 2.0), 3.0, STILL), ((1.0, 0.0, 2.0), 2.0, STILL)], "path: time: Input should be greater"),
        ([((0.0, 0.0, 2.0), 0.0, STILL)] * 501, "path: points: Tuple should have at most 500 items"),
    ],
)
def test_what_is_no_path_is_refused(poses, words):
    with pytest.raises(MkError) as refused:
        commands.path_request(ros_path(*poses), 0.5)
    assert words in str(refused.value)


@given(st.tuples(finite, finite, finite), st.floats(-3.1, 3.1))
def test_a_pose_is_a_place_and_a_heading(place, yaw):
    turned = quaternion_from_rotation(rotation_from_euler(0.0, 0.0, yaw))
    fields = commands.position_fields(pose(TYPES, place, turned), "pad")
    assert (fields["position"], fields["frame"]) == (place, "pad")
    assert fields["yaw"] == pytest.approx(yaw, abs=1e-9)
    assert commands.position_fields(pose(TYPES, place, STILL), "pad")["yaw"] is None, "zeros keep the heading"


@pytest.mark.parametrize(("frame_id", "word"), [("", "body"), ("mk1/base_link", "body"), ("mk1/target/pad", "pad")])
def test_frames_that_are_flown_and_another_is_refused_with_those_there_are(frame_id, word):
    assert commands.setpoint_frame(frame_id, Frames("mk1/"), "body") == word
    for wrong in ("map", "odom", "base_link", "target/pad"):
        with pytest.raises(MkError, match="mk1/base_link or mk1/target/NAME"):
            commands.setpoint_frame(wrong, Frames("mk1/"), "body")
