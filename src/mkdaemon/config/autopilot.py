"""Configuration of flight by position and velocity setpoints."""

from __future__ import annotations

from pydantic import Field

from mkdaemon.config.base import Section


class AutopilotConfig(Section):
    """Limits of autonomous flight, and what must be true before and during it; docs/flying.md."""

    max_tilt: float = Field(default=0.35, gt=0, le=0.6)
    """Largest tilt asked of the attitude loop [rad]; the true tilt stays near three quarters of it."""
    max_speed: float = Field(default=1.2, gt=0, le=5)
    """Largest horizontal speed of the reference [m/s]."""
    max_acceleration: float = Field(default=1.4, gt=0, le=3)
    """Largest horizontal acceleration of the reference [m/s2]."""
    max_climb: float = Field(default=0.6, gt=0, le=2)
    """Largest vertical speed [m/s]."""
    fence_radius: float = Field(default=5.0, gt=0, le=100)
    """Setpoints farther from the target are moved back to this distance [m]."""
    fence_height: float = Field(default=6.0, gt=0, le=100)
    """Setpoints higher above the target are lowered to this height [m]."""
    fence_floor: float = Field(default=0.3, ge=0, le=10)
    """Setpoints lower above the target are raised to this height [m]; landing is a thing of its own."""
    velocity_lead: float = Field(default=1.5, gt=0, le=5)
    """A velocity setpoint aims at the point the aircraft would reach in this time [s]."""
    entry_sd: float = Field(default=0.15, gt=0, le=1)
    """Position must be known to this standard deviation before a flight begins [m]."""
    entry_age: float = Field(default=0.25, gt=0, le=1)
    """The newest image must be younger than this before a flight begins [s]."""
    entry_speed: float = Field(default=0.4, gt=0, le=5)
    """The aircraft must be slower than this against the target before a flight begins [m/s]."""
    entry_offset: float = Field(default=0.3, gt=0, le=10)
    """The aircraft must be nearer to the middle of the target than this share of its height before a flight begins: who
    leans against the wind beside it loses sight of it."""
    entry_clean: float = Field(default=2.0, ge=0, le=20)
    """Images must have agreed with the model for this long before a flight begins [s]."""
    clean_innovation: float = Field(default=4.0, gt=0)
    """Mean squared innovation up to which images agree with the model [variances]."""
    freeze_after: float = Field(default=0.2, gt=0, le=2)
    """Without an image for this long the reference stands still [s]."""
    level_after: float = Field(default=1.5, gt=0, le=5)
    """Without an image for this long the aircraft is held level at hover throttle [s]."""
    exit_after: float = Field(default=3.0, gt=0, le=10)
    """Without an image for this long the aircraft is released [s]."""
    stand_height: float = Field(default=0.10, ge=0, le=1)
    """Height of the body's origin above the target when the feet stand on it [m]."""
    stand_time: float = Field(default=1.0, ge=0, le=5)
    """After a landing the throttle stays at its lowest for this long before the aircraft is released [s]."""
    arrived_within: float = Field(default=0.15, gt=0, le=2)
    """A position is reached when the aircraft has been so close to it for `arrived_for` [m]."""
    arrived_for: float = Field(default=1.0, gt=0, le=10)
    """See `arrived_within` [s]."""
    takeoff_ready: float = Field(default=3.0, ge=0, le=30)
    """A take-off begins with the lowest throttle for this long, in which the pilot raises his [s]."""
    neutral_band: float = Field(default=4.0, ge=0, le=20)
    """Attitude setpoints within this many counts of level begin a flight [stick]."""
