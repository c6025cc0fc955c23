"""Stick commands to the wire: every layout's own signs and zero."""

from __future__ import annotations

import pytest

from mkdaemon.control.limiter import RANGES, StickCounts
from mkdaemon.errors import EncodeError
from mkdaemon.protocol.flags import ControlConfig
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2, ExternControlV3
from mkdaemon.translate import extern_control

LAYOUTS = {"v1": ExternControlV1, "v2": ExternControlV2, "v3": ExternControlV3}
NOSE_DOWN_RIGHT_DOWN_NOSE_LEFT = StickCounts(pitch=20, roll=30, yaw=40, throttle=10)


@pytest.mark.parametrize(
    ("layout", "wire"),
    [
        # Stick left is positive for roll; v1 counts yaw clockwise and throttle from the bottom.
        (ExternControlV1, {"pitch": 20, "roll": -30, "yaw": -40, "throttle": 137}),
        (ExternControlV2, {"pitch": 20, "roll": -30, "yaw": 40, "throttle": 10}),
        (ExternControlV3, {"pitch": 20, "roll": -30, "yaw": 40, "throttle": 10}),
    ],
)
def test_each_layout_has_its_own_signs_and_zero(layout, wire):
    message = extern_control(layout, NOSE_DOWN_RIGHT_DOWN_NOSE_LEFT, frame=7)
    assert isinstance(message, layout)
    assert wire.items() <= message.model_dump().items()
    assert (message.frame, message.config) == (7, ControlConfig.VALID)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_the_limiters_range_is_what_the_layout_declares(name):
    layout, room = LAYOUTS[name], RANGES[name]
    for axis in ("pitch", "roll", "yaw"):
        for count in (-room.tilt, room.tilt):
            extern_control(layout, StickCounts(**{"pitch": 0, "roll": 0, "yaw": 0, "throttle": 0, axis: count}), 1)
        wire = layout.spec.wire(axis)
        assert (wire.minimum, wire.maximum) == (-room.tilt, room.tilt)
    for count in (room.lowest, room.highest):
        assert extern_control(layout, StickCounts(0, 0, 0, count), 1).encode()


@pytest.mark.parametrize("axis", ["pitch", "roll", "yaw", "throttle"])
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_what_does_not_fit_is_never_sent(layout, axis):
    sticks = {"pitch": 0, "roll": 0, "yaw": 0, "throttle": 0, axis: -129}
    with pytest.raises(EncodeError):
        extern_control(layout, StickCounts(**sticks), 1)
