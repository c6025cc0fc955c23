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
    """Largest yaw command [stick]; more than 70 never leaves, because stick gestures begin at 75.

    Lower turns more slowly."""
    min_throttle: int = Field(default=-100, ge=-127, le=127)
    """Smallest throttle command [stick from the centre].

    Lower lets it fall faster, and attitude authority goes with throttle; too near hover it cannot sink."""
    max_throttle: int = Field(default=80, ge=-127, le=127)
    """Largest throttle command [stick from the centre].

    Too near hover it cannot climb or stop sinking."""
    slew: float = Field(default=600.0, gt=0, le=20_000)
    """Fastest change of pitch, roll and yaw [stick/s].

    Lower delays every stick command, which can make the loop unstable: that is refused at the start."""
    throttle_slew: float = Field(default=300.0, gt=0, le=20_000)
    """Fastest change of throttle [stick/s].

    Lower makes climb and sink sluggish; higher makes steps."""
    setpoint_ttl: float = Field(default=0.3, gt=0, le=1.0)
    """Age from which a setpoint counts as stale, whatever longer life it claims [s]; docs/safety.md.

    Longer flies on with an old setpoint after its client died; shorter levels the aircraft at every late one."""
    hover_throttle: float = Field(default=-2.0, ge=LOWEST_HOVER, le=HIGHEST_HOVER)
    """Throttle that carries the aircraft, held while a setpoint is stale [stick from the centre]; about 125 of 254.

    Wrong by 10 climbs or sinks while a setpoint is stale, and in the first second of a flight."""

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

    Longer keeps others from flying after a client died; shorter loses the lease over a slow network."""
    release_after: float = Field(default=1.0, gt=0, le=5)
    """Silence after which a flying client loses the lease and the aircraft is released [s].

    Longer keeps neutral sticks for that time after a client died; shorter releases at a hiccup of the
    network."""
    engage_after: float = Field(default=1.0, ge=0, le=10)
    """A stream must have lived this long, with neutral sticks, before its first command is sent [s].

    Shorter takes over from a stream that has just begun and may end at once."""
    engage_rate: float = Field(default=2.0, gt=0, le=50)
    """A slower stream does not count as live [Hz].

    Lower lets a stream begin that stutters."""
    neutral_band: float = Field(default=4.0, ge=0, le=20)
    """Pitch, roll and yaw within this count as neutral [stick].

    Wider lets a flight begin with a step; narrower refuses a stick that does not return exactly."""
    max_path_delay: float = Field(default=0.5, gt=0, le=10)
    """Longest way to a client and back that gets the lease [s]; every limit of the ladder comes later by it.

    Higher allows a flight in which every safety limit comes later by it."""
    allow_constant_gate: bool = False
    """Fly although ExternalControl is a constant, so that no switch of the transmitter ends external control.

    True: nothing on the transmitter ends external control; only the daemon or its guard ends it."""


class ControlConfig(Section):
    """From setpoints to stick commands."""

    rate: float = Field(default=50.0, ge=10, le=100)
    """Stick frames a second while someone flies [Hz]; above 44 gains nothing, above 100 the boards lose frames. In a
    flight by images one more answers each image.

    Lower answers later; higher takes the line from telemetry."""
    real_time: bool | None = None
    """Run the event loop and vision at the lowest real-time priority, and the daemon's threads before other programs;
    what that can starve: docs/operations.md. Unset: as a service of systemd only.

    True can starve the shell on a machine with one core; false comes late beside busy programs."""
    guard: bool = True
    """A separate process releases the aircraft if the daemon dies or hangs; docs/safety.md.

    False: a daemon that dies in flight leaves its last sticks until the boards' own time-out, up to 5 s."""
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
