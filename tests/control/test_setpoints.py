"""Every kind of setpoint takes the same way; a manoeuvre decides what becomes of it."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from mkdaemon.config.control import ControlConfig, LeaseConfig
from mkdaemon.control.actions import ReportCommand
from mkdaemon.control.limiter import Sticks
from mkdaemon.control.manoeuvres.manoeuvre import Step
from mkdaemon.control.manoeuvres.table import MANOEUVRES
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import (
    SETPOINTS,
    AttitudeSetpoint,
    HoldSetpoint,
    LandSetpoint,
    PathSetpoint,
    PositionSetpoint,
    Setpoint,
    StickSetpoint,
    TakeOffSetpoint,
    VelocitySetpoint,
)
from tests.control.events import PERIOD, Driver
from tests.control.flying import Flying

STICKS_ALONE = {StickSetpoint: MANOEUVRES[StickSetpoint]}
BASE = {"epoch": 100, "sequence": 1, "ttl": 0.3}
EXAMPLES: dict[type[Setpoint], dict[str, object]] = {
    StickSetpoint: {"pitch": 1, "roll": 2, "yaw": 3, "throttle": 4},
    AttitudeSetpoint: {"roll": 0.1, "pitch": 0, "yaw_rate": 0, "thrust": 1},
    VelocitySetpoint: {"velocity": [0.5, 0, -0.1], "frame": "pad"},
    PositionSetpoint: {"position": [1, 2, 3], "frame": "home"},
    HoldSetpoint: {},
    TakeOffSetpoint: {"height": 2.0},
    LandSetpoint: {},
    PathSetpoint: {"path": "p1"},
}


def example(kind, **change):
    return kind.model_validate({**BASE, **EXAMPLES[kind], **change})


def test_every_kind_has_a_key_of_its_own_and_an_example():
    assert set(EXAMPLES) == set(SETPOINTS)
    assert len({kind.suffix for kind in SETPOINTS}) == len(SETPOINTS)


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (AttitudeSetpoint, {"roll": 1.0}),
        (AttitudeSetpoint, {"thrust": -0.1}),
        (AttitudeSetpoint, {"pitch": math.nan}),
        (VelocitySetpoint, {"velocity": [1, 2]}),
        (VelocitySetpoint, {"velocity": [math.inf, 0, 0]}),
        (VelocitySetpoint, {"velocity": [21, 0, 0]}),
        (VelocitySetpoint, {"velocity": ["1", 0, 0]}),
        (VelocitySetpoint, {"frame": "ned"}),
        (PositionSetpoint, {"position": [20_000, 0, 0]}),
        (PositionSetpoint, {"yaw": 4.0}),
        (PositionSetpoint, {"epoch": None}),
        (PositionSetpoint, {"heading": 0.0}),
    ],
)
def test_what_is_out_of_range_or_unknown_is_refused(kind, change):
    with pytest.raises(ValidationError):
        example(kind, **change)


def test_stick_setpoints_are_their_own_sticks():
    wanted = example(StickSetpoint)
    assert Flying().step(wanted, 0.0) == Step(Sticks(1.0, 2.0, 3.0, 4.0), "stick")
    narrow = ControlConfig(lease=LeaseConfig(neutral_band=2.0))
    assert Flying(narrow).step(wanted, 0.0).obstacle == "waiting for neutral sticks"


@pytest.mark.parametrize("kind", [kind for kind in SETPOINTS if kind not in STICKS_ALONE])
def test_a_kind_without_guidance_does_not_touch_the_stream_of_the_lease(kind):
    drive = Driver(rows=STICKS_ALONE)
    epoch = drive.fly()
    for _ in range(10):
        drive.sequence += 1
        drive.offer(example(kind, epoch=epoch, sequence=drive.sequence))
        drive.put()
        drive.run(PERIOD)
    assert drive.core.phase is Phase.FLYING
    assert [sent.age for sent in drive.sticks] == [0.0] * 10
    [refusal] = drive.of(ReportCommand)
    assert (refusal.key, refusal.result.token) == (kind.suffix, "no_guidance")
    assert kind.suffix in refusal.result.reason
    assert "setpoint/stick" in refusal.result.reason
