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
from mkdaemon.gateways.ros2.commands import AXES, BUTTONS, GONE, SILENCE, CommandStream
from mkdaemon.gateways.ros2.messages import Frames, pose, vector
from tests.gateways.ros2.bagtypes import BagTypes

TYPES = BagTypes()
finite = st.floats(-20, 20)


def joy(axes=(0.0,) * 8, buttons=(0,) * 11):
    return SimpleNamespace(axes=list(axes), buttons=list(buttons))


def twist(linear=(0.0, 0.0, 0.0), turn=0.0):
    return TYPES.new("geometry_msgs/msg/Twist", linear=vector(TYPES, linear), angular=vector(TYPES, (0.0, 0.0, turn)))


def test_left_and_up_of_ros_are_right_and_down_of_the_kernel_turned_round():
    state = commands.pad_state(
        joy(axes=(1.0, 0.5, 0, 0, 0, 0, 0, -1.0), buttons=(0, 0, 0, 0, 1, *(0,) * 6)), AXES, BUTTONS
    )
    assert (state["ABS_X"], state["ABS_Y"], state["ABS_HAT0Y"]) == (-1.0, -0.5, 1.0)
    assert [name for name, value in state.items() if name in BUTTONS and value] == ["BTN_TL"]


@pytest.mark.parametrize("wrong", [joy(axes=(0.0,) * 4), joy(buttons=(0,) * 4), joy(axes=(math.nan,) * 8)])
def test_another_pad_is_refused(wrong):
    with pytest.raises(MkError):
        commands.pad_state(wrong, AXES, BUTTONS)


def at_time(at):
    """A header of a time [s]."""
    return SimpleNamespace(stamp=SimpleNamespace(sec=int(at), nanosec=round(at % 1.0 * 1e9)))


def test_age_is_by_the_stamp_and_never_negative():
    ages = {at: commands.age_of(at_time(at).stamp, 101.0) for at in (100.5, 102.0, 0.0)}
    assert ages == {100.5: pytest.approx(0.5), 102.0: 0.0, 0.0: 0.0}
    newer = [commands.newer(at_time(at).stamp, last) for at, last in ((0, (0, 0)), (1, (0, 0)), (1.5, (1, 5 * 10**8)))]
    assert newer == [True, True, False]


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


@given(st.tuples(finite, finite, finite), finite)
def test_a_twist_is_a_velocity_in_its_frame(linear, turn):
    fields = commands.velocity_fields(twist(linear, turn), "body")
    assert fields == {"velocity": linear, "frame": "body", "yaw_rate": turn}


@given(st.tuples(finite, finite, finite), st.floats(-3.1, 3.1))
def test_a_pose_is_a_place_and_a_heading(place, yaw):
    turned = quaternion_from_rotation(rotation_from_euler(0.0, 0.0, yaw))
    fields = commands.position_fields(pose(TYPES, place, turned), "pad")
    assert (fields["position"], fields["frame"]) == (place, "pad")
    assert fields["yaw"] == pytest.approx(yaw, abs=1e-9)
    assert commands.position_fields(pose(TYPES, place, STILL), "pad")["yaw"] is None, "zeros keep the heading"


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_no_number_is_refused(bad):
    with pytest.raises(MkError):
        commands.velocity_fields(twist((0.0, bad, 0.0)), "body")
    with pytest.raises(MkError):
        commands.position_fields(pose(TYPES, (0, 0, 2), (1, 0, 0, bad)), "pad")


@pytest.mark.parametrize(("frame_id", "word"), [("", "body"), ("mk1/base_link", "body"), ("mk1/target/pad", "pad")])
def test_frames_that_are_flown_and_another_is_refused_with_those_there_are(frame_id, word):
    assert commands.setpoint_frame(frame_id, Frames("mk1/"), "body") == word
    for wrong in ("map", "odom", "base_link", "target/pad"):
        with pytest.raises(MkError, match="mk1/base_link or mk1/target/NAME"):
            commands.setpoint_frame(wrong, Frames("mk1/"), "body")


def test_what_has_ended_must_be_silent_before_it_counts_again():
    stream = CommandStream("cmd_vel")
    assert stream.is_gone(0.0)
    assert stream.arrived(0.0)
    assert not stream.is_gone(GONE - 0.01)
    assert stream.is_gone(GONE)
    stream.ended()
    for tick in range(1, 50):
        assert not stream.arrived(tick * 0.1), "it streams on, and stays shut"
    assert stream.arrived(4.9 + SILENCE)
    assert stream.arrived(5.0 + SILENCE)
