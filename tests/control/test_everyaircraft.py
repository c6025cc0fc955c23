"""Whatever the parameter set and the configuration say: a setpoint and a tick never end the control task."""

from __future__ import annotations

import math

import pytest
from annotated_types import Ge, Gt, Le, Lt
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.config.control import ControlConfig, LeaseConfig, LimiterConfig
from mkdaemon.control.estimator.model import AircraftModel, ModelUnknown
from mkdaemon.control.events import ModelKnown, PoseSeen
from mkdaemon.telemetry.setpoint import AttitudeSetpoint, PositionSetpoint, SetpointFrame
from tests.control.events import PERIOD, Driver, pose

GAINS = st.fixed_dictionaries(
    {
        name: st.integers(0, 255)
        for name in ("stick_p", "gyro_p", "gyro_i", "integral_factor", "gyro_stability", "stick_yaw_p")
    }
)


def numbers(field):
    """Values that a field of a configuration takes, its bounds first of all."""
    low, high, is_open = -1e4, 1e4, False
    for bound in field.metadata:
        match bound:
            case Ge(ge=value):
                low = value
            case Gt(gt=value):
                low, is_open = value, True
            case Le(le=value):
                high = value
            case Lt(lt=value):
                high = math.nextafter(value, -math.inf)
    if field.annotation is int:
        return st.integers(int(low), int(high))
    return st.floats(low, high, exclude_min=is_open, allow_subnormal=False)


def sections(kind):
    """Any legal section of the configuration."""
    fields = {name: numbers(field) for name, field in kind.model_fields.items() if field.annotation in {int, float}}
    return st.fixed_dictionaries({}, optional=fields).map(lambda given: _legal(kind, given))


def _legal(kind, fields):
    try:
        return kind(**fields)
    except ValidationError:
        assume(False)


CONFIGS = st.builds(
    lambda rate, limiter, lease, autopilot: _legal(
        ControlConfig,
        {
            "rate": rate,
            "limiter": limiter,
            "lease": lease.model_copy(update={"engage_after": 0.0}),
            "autopilot": autopilot,
        },
    ),
    numbers(ControlConfig.model_fields["rate"]),
    sections(LimiterConfig),
    sections(LeaseConfig),
    sections(AutopilotConfig),
)
ANGLE = st.floats(-0.6, 0.6)


def flown(cfg, gains):
    """A core over its target, which knows the model of a set, or has refused it."""
    model = AircraftModel.from_parameters(**gains, has_stick_filter=True, has_slow_leak=False)
    drive = Driver(cfg)
    if isinstance(model, ModelUnknown):
        drive.core.feed(ModelKnown(AircraftModel(), model), drive.now)
    else:
        drive.core.feed(ModelKnown(model), drive.now)
    drive.core.feed(PoseSeen(pose(0.0)), drive.now)
    drive.take(ttl=None)
    return drive


@settings(max_examples=10, deadline=None)
@given(CONFIGS, GAINS, ANGLE, ANGLE, st.floats(-2.0, 2.0), st.floats(0.0, 2.0))
def test_an_attitude_flies_or_is_refused_with_every_set_and_every_configuration(cfg, gains, pitch, roll, rate, thrust):
    drive = flown(cfg, gains)
    for k in range(6):
        wanted = {"pitch": pitch, "roll": roll, "yaw_rate": rate, "thrust": thrust} if k > 3 else {}
        drive.send(AttitudeSetpoint, **{"pitch": 0.0, "roll": 0.0, "yaw_rate": 0.0, "thrust": 1.0} | wanted)
        drive.now += max(PERIOD, 1.0 / cfg.rate)
        drive.core.feed(PoseSeen(pose(drive.now - 0.05)), drive.now)
        drive.tick()
    for sent in drive.sticks:
        assert cfg.limiter.min_throttle <= sent.counts.throttle <= cfg.limiter.max_throttle


@settings(max_examples=10, deadline=None)
@given(CONFIGS, GAINS)
def test_a_position_flies_or_is_refused_with_every_set_and_every_configuration(cfg, gains):
    drive = flown(cfg, gains)
    for _ in range(8):
        drive.send(PositionSetpoint, position=(0.0, 0.0, 2.0), frame=SetpointFrame.PAD)
        drive.now += max(PERIOD, 1.0 / cfg.rate)
        drive.core.feed(PoseSeen(pose(drive.now - 0.05)), drive.now)
        drive.tick()
    assert all(math.isfinite(sent.wanted.pitch) for sent in drive.sticks)


@pytest.mark.parametrize("hover", [-127, -68, 64, 127])
def test_a_hover_throttle_that_carries_no_aircraft_is_no_configuration(hover):
    with pytest.raises(ValidationError, match="hover_throttle"):
        LimiterConfig(min_throttle=-127, max_throttle=127, hover_throttle=hover)
