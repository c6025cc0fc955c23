"""The table of parameters, and what they mean."""

from __future__ import annotations

import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.gateways.ros2 import topics
from mkdaemon.gateways.ros2.parameters import PARAMETERS, Pace, settings_of


def test_a_rate_is_kept_by_the_stamps():
    pace = Pace({"imu": 10.0})
    through = [n for n in range(100) if pace.lets_through("imu", "imu", n * 0.02)]
    assert len(through) == 20
    assert all(pace.lets_through("fix", "fix", 0.0) for _ in range(3)), "without a limit everything goes"
    assert pace.lets_through("imu", "imu", 0.5), "a clock that begins again stops nothing"


GIVEN = {row.name: row.default for row in PARAMETERS}


def test_the_defaults_of_the_parameters_fly():
    settings = settings_of(GIVEN)
    assert settings.topics == frozenset(topics.words())
    assert settings.commands
    assert (settings.velocity_frame, settings.pose_frame) == ("body", "pad")
    assert settings.habits.mapping.buttons.enable == "BTN_TL"
    assert settings_of(GIVEN | {"topics": ["imu", "raw.rx"]}).topics == {"imu", "raw.rx"}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("topics", ["imus"], "topics does not know imus"),
        ("cmd_vel.frame", "home", "cmd_vel.frame is body or pad"),
        ("take_off.height", 0.1, "take_off.height"),
        ("hold.seconds", float("inf"), "hold.seconds"),
        ("joy.mapping", "nopad", "there is 8bitdo"),
        ("joy.mapping", "no/such.toml", "no such configuration file"),
    ],
)
def test_a_wrong_parameter_is_named(name, value, words):
    with pytest.raises(ConfigError, match=words):
        settings_of(GIVEN | {name: value})
