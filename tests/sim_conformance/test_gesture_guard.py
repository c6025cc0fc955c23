"""What the limiter lets through can never be a stick gesture of the FlightCtrl, whatever the pilot's throttle is."""

from __future__ import annotations

import pytest

from mkdaemon.config.control import LimiterConfig
from mkdaemon.control.limiter import Sticks, count, limit
from mkdaemon.protocol.flags import ControlConfig
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2, ExternControlV3
from mkdaemon.translate import extern_control
from mksim.boards import external
from mksim.boards.generations import FC_GENERATIONS
from mksim.boards.gestures import CALIBRATE_TIME, MOTOR, GestureReader
from mksim.config import GasLaw

WIDE = LimiterConfig(
    max_pitch=127, max_roll=127, max_yaw=127, min_throttle=-127, max_throttle=127, slew=20_000, throttle_slew=20_000
)
LAYOUTS = {"v1": ExternControlV1, "v2": ExternControlV2, "v3": ExternControlV3}
RELEASES = {"early": "v1", "2.08": "v1", "2.12a": "v2", "2.14": "v3"}


@pytest.mark.parametrize("release", RELEASES)
@pytest.mark.parametrize("law", list(GasLaw))
@pytest.mark.parametrize("pilot_throttle", [-125, -90, 0, 90, 125])
def test_no_corner_of_the_sticks_is_a_gesture(release, law, pilot_throttle):
    layout = RELEASES[release]
    pilot = external.ExternalSticks(0.0, 0.0, 0.0, float(pilot_throttle))
    for yaw in (-127.0, 127.0):
        for throttle in (-127.0, -101.0, -100.0, -50.0, 0.0, 79.0, 81.0, 99.0, 100.0, 127.0):
            wanted = Sticks(127.0, 127.0, yaw, throttle)
            counts = count(limit(wanted, wanted, age=0.0, ttl=0.3, dt=0.02, layout=layout, cfg=WIDE))
            control = external.ExternalControl(FC_GENERATIONS[release], law)
            message = extern_control(LAYOUTS[layout], counts, 1)
            control.take(message.encode())
            assert control.held.config & ControlConfig.VALID
            reader, mixed = GestureReader(), control.mix(pilot)
            for tick in range(100):
                assert reader.read(mixed, tick * 0.0225, plain=True) is None, (counts, mixed)
            assert tick * 0.0225 > max(CALIBRATE_TIME, MOTOR)
