"""Configuration of flight by position and velocity setpoints."""

from __future__ import annotations

from pydantic import Field

from mkdaemon.config.base import Section


class AutopilotConfig(Section):
    """Limits of autonomous flight, and what must be true before and during it; docs/flying.md."""

    max_tilt: float = Field(default=0.35, gt=0, le=0.6)
    """Largest tilt asked of the attitude loop [rad]; the true tilt stays near three quarters of it.

    Higher flies faster and overshoots farther; lower cannot hold against wind."""
    max_speed: float = Field(default=1.2, gt=0, le=5)
    """Largest horizontal speed of the reference [m/s].

    Higher needs more room to stop, and the target leaves the image."""
    max_acceleration: float = Field(default=1.4, gt=0, le=3)
    """Largest horizontal acceleration of the reference [m/s2].

    Higher tilts the camera away from the target; lower brakes over a longer way."""
    max_climb: float = Field(default=0.6, gt=0, le=2)
    """Largest vertical speed [m/s].

    Higher overshoots; lower takes longer."""
    fence_radius: float = Field(default=5.0, gt=0, le=100)
    """Setpoints farther from the target are moved back to this distance [m].

    Wider lets a wrong setpoint fly away; narrower moves right ones back."""
    fence_height: float = Field(default=6.0, gt=0, le=100)
    """Setpoints higher above the target are lowered to this height [m].

    If the camera cannot see the target from this height, flights lose sight and end."""
    fence_floor: float = Field(default=0.3, ge=0, le=10)
    """Setpoints lower above the target are raised to this height [m]; landings are exempt.

    Lower lets a setpoint touch the ground without landing."""
    velocity_lead: float = Field(default=1.5, gt=0, le=5)
    """A velocity setpoint aims at the point the aircraft would reach in this time [s].

    Longer makes velocity flight sluggish; shorter makes it jerky."""
    entry_sd: float = Field(default=0.15, gt=0, le=1)
    """Position must be known to this standard deviation before a flight begins [m].

    Higher starts flights with a poorly known position; lower never starts one in bad light."""
    entry_age: float = Field(default=0.25, gt=0, le=1)
    """The newest image must be younger than this before a flight begins [s].

    Higher starts flights with old images."""
    entry_speed: float = Field(default=0.4, gt=0, le=5)
    """The aircraft must be slower than this against the target before a flight begins [m/s].

    Higher starts flights that overshoot."""
    entry_offset: float = Field(default=0.3, gt=0, le=10)
    """The aircraft must be nearer to the middle of the target than this share of its height before a flight begins: an
    aircraft that leans into the wind beside it loses sight of it.

    Higher starts flights that lose sight at the first tilt."""
    entry_clean: float = Field(default=2.0, ge=0, le=20)
    """Images must have agreed with the model for this long before a flight begins [s].

    Shorter starts flights with images that agree by chance."""
    clean_innovation: float = Field(default=4.0, gt=0)
    """Mean squared innovation up to which images agree with the model [variances].

    Higher accepts images that contradict the model."""
    freeze_after: float = Field(default=0.2, gt=0, le=2)
    """Without an image for this time the reference stops [s].

    Longer follows a reference without a measurement; shorter stops at every lost image."""
    search_after: float = Field(default=1.0, gt=0, le=5)
    """Without an image for this long the aircraft rises and returns to where the target was seen last [s].

    Longer waits while the wind moves the aircraft; shorter starts a search at every missing image."""
    level_after: float = Field(default=1.5, gt=0, le=5)
    """Age up to which an image is used to hold or land [s].

    Longer starts a landing on a target that may have left the image."""
    exit_after: float = Field(default=3.0, gt=0, le=10)
    """Without an image for this long the aircraft is released [s].

    With a longer time, the level aircraft drifts farther with the wind before the release."""
    stand_height: float = Field(default=0.10, ge=0, le=1)
    """Height of the body's origin above the target after landing [m].

    Too high ends a landing in the air; too low pushes on the ground before it ends."""
    stand_time: float = Field(default=1.0, ge=0, le=5)
    """After a landing the throttle stays at its lowest for this long before the aircraft is released [s].

    Shorter releases while it may still bounce."""
    arrived_within: float = Field(default=0.15, gt=0, le=2)
    """A position is reached when the aircraft stays within this distance for `arrived_for` [m].

    If narrower than the hold accuracy, it is never reached."""
    arrived_for: float = Field(default=1.0, gt=0, le=10)
    """See `arrived_within` [s].

    Longer waits at every position."""
    takeoff_ready: float = Field(default=3.0, ge=0, le=30)
    """A take-off starts with the lowest throttle for this time, in which the pilot raises the throttle stick [s].

    Shorter leaves the pilot no time, and the pilot's throttle limits ours."""
    neutral_band: float = Field(default=4.0, ge=0, le=20)
    """Attitude setpoints within this distance of level start a flight [stick].

    Wider lets a flight start with a step."""
