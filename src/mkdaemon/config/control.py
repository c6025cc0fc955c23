"""Configuration of authority over the aircraft and of the final limiter."""

from __future__ import annotations

from typing import Final, Self

from pydantic import Field, model_validator

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.config.base import Section

LOWEST_HOVER: Final = -67.0
"""Smallest throttle that may be hover throttle [stick from the centre]: 60 counts of 254."""
HIGHEST_HOVER: Final = 63.0
"""Largest throttle that may be hover throttle [stick from the centre]: 190 counts of 254."""


class LimiterConfig(Section):
    """Bounds of every stick command of every client. Stick counts are the receiver's, full deflection about 125."""

    max_pitch: int = Field(default=60, ge=0, le=127)
    """Largest pitch command [stick].

    Higher allows steeper tilt and faster flight; lower cannot hold against wind."""
    max_roll: int = Field(default=60, ge=0, le=127)
    """Largest roll command [stick].

    Higher allows steeper tilt and faster flight; lower cannot hold against wind."""
    max_yaw: int = Field(default=60, ge=0, le=127)
    """Largest yaw command [stick]; 70 is never exceeded, because stick gestures begin at 75.

    Lower turns more slowly."""
    min_throttle: int = Field(default=-100, ge=-127, le=127)
    """Smallest throttle command [stick from the centre].

    A lower value allows a faster descent with less attitude authority; too near hover, the aircraft cannot sink."""
    max_throttle: int = Field(default=80, ge=-127, le=127)
    """Largest throttle command [stick from the centre].

    Too near hover, the aircraft cannot climb or stop sinking."""
    slew: float = Field(default=600.0, gt=0, le=20_000)
    """Fastest change of pitch, roll and yaw [stick/s].

    Lower delays every stick command; if that makes the loop unstable, flights are refused."""
    throttle_slew: float = Field(default=300.0, gt=0, le=20_000)
    """Fastest change of throttle [stick/s].

    Lower slows climb and descent; higher makes them jerky."""
    setpoint_ttl: float = Field(default=0.3, gt=0, le=1.0)
    """Age from which a setpoint counts as stale, even if its own limit is longer [s]; docs/safety.md.

    Longer keeps an old setpoint of a dead client in effect; shorter levels the aircraft at every late setpoint."""
    hover_throttle: float = Field(default=-2.0, ge=LOWEST_HOVER, le=HIGHEST_HOVER)
    """Throttle that carries the aircraft, held while a setpoint is stale [stick from the centre]; about 125 of 254.

    With an error of 10 the aircraft climbs or sinks while a setpoint is stale, and in the first second of a flight."""

    @model_validator(mode="after")
    def _throttle_in_order(self) -> Self:
        if not self.min_throttle <= self.hover_throttle <= self.max_throttle:
            msg = (
                f"min_throttle {self.min_throttle:g} <= hover_throttle {self.hover_throttle:g} <= "
                f"max_throttle {self.max_throttle:g} does not hold"
            )
            raise ValueError(msg)
        return self


class LeaseConfig(Section):
    """The lease: limits of a client that flies; docs/safety.md."""

    ttl: float = Field(default=5.0, ge=0.5, le=60)
    """A lease without setpoints or renewal ends after this time, unless the client asked for less [s].

    Longer blocks other clients after a client died; shorter loses the lease over a slow network."""
    release_after: float = Field(default=1.0, gt=0, le=5)
    """Silence after which a flying client loses the lease and the aircraft is released [s].

    Longer keeps neutral sticks for longer after a client died; shorter releases at a short network delay."""
    engage_after: float = Field(default=1.0, ge=0, le=10)
    """Time for which a stream with neutral sticks must last before its first command is sent [s].

    Shorter engages a stream that has just begun and may end at once."""
    engage_rate: float = Field(default=2.0, gt=0, le=50)
    """Lowest rate of a live stream [Hz].

    Lower engages an irregular stream."""
    neutral_band: float = Field(default=4.0, ge=0, le=20)
    """Pitch, roll and yaw within this count as neutral [stick].

    Wider lets a flight start with a step; narrower refuses a stick that does not return exactly."""
    max_path_delay: float = Field(default=0.5, gt=0, le=10)
    """Longest round trip to a client that may take the lease [s]; it delays every safety limit.

    Higher allows flights whose safety limits act later."""
    allow_constant_gate: bool = False
    """Allow flights with a constant ExternalControl, which no switch of the transmitter can end.

    With true, only the daemon or its guard can end external control."""


class ControlConfig(Section):
    """From setpoints to stick commands."""

    rate: float = Field(default=50.0, ge=10, le=100)
    """Rate of stick frames in flight [Hz]; above 44 there is no gain, above 100 the boards lose frames. In a flight by
    images, each image causes one additional frame.

    Lower responds later; higher takes room from telemetry."""
    real_time: bool | None = None
    """Run the event loop and vision at the lowest real-time priority, and the daemon's threads before other programs;
    docs/operations.md has the side effects. Unset: only as a service of systemd.

    True can block the shell on a machine with one core; with false, busy programs delay the daemon."""
    guard: bool = True
    """A separate process releases the aircraft if the daemon dies or hangs; docs/safety.md.

    With false, the last sticks of a daemon that dies in flight stay in effect until the boards' time-out, up to 5 s."""
    limiter: LimiterConfig = LimiterConfig()
    """Bounds of every stick command."""
    lease: LeaseConfig = LeaseConfig()
    """The lease."""
    autopilot: AutopilotConfig = AutopilotConfig()
    """Flight by position and velocity setpoints."""

    @model_validator(mode="after")
    def _stale_before_release(self) -> Self:
        if self.limiter.setpoint_ttl >= self.lease.release_after:
            msg = "lease.release_after must be longer than limiter.setpoint_ttl: first neutral sticks, then release"
            raise ValueError(msg)
        return self
