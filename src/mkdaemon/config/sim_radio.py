"""Configuration of the simulated serial link: each direction its own."""

from __future__ import annotations

from enum import StrEnum
from typing import Self

from pydantic import Field, model_validator

from mkdaemon.config.base import Section


class RadioKind(StrEnum):
    """What carries the bytes."""

    WIRED = "wired"
    XBEE = "xbee"


class ChannelConfig(Section):
    """One direction of the link."""

    kind: RadioKind = RadioKind.WIRED
    """A cable, or a pair of XBee modules in transparent mode."""
    baud: float = Field(default=57600.0, ge=1200.0)
    """Line rate on both ends [bit/s]; ten bits a byte."""
    latency_min: float = Field(default=0.013, ge=0.0)
    """XBee: shortest way of a packet through the air [s]."""
    latency_mean: float = Field(default=0.023, ge=0.0)
    """XBee: mean [s]; the standard deviation comes out at 9.4 ms with the defaults, 9 to 10 was measured."""
    latency_max: float = Field(default=0.062, ge=0.0)
    """XBee: the spikes [s]."""
    loss: float = Field(default=0.01, ge=0.0, le=0.5)
    """XBee: share of packets lost, in bursts."""
    mean_burst: float = Field(default=4.0, ge=1.0)
    """XBee: packets lost in a row, on average."""
    outages_per_minute: float = Field(default=0.0, ge=0.0)
    """Drop-outs of the whole direction, at random [1/min]."""
    outage_duration: float = Field(default=1.0, gt=0.0)
    """Length of a drop-out [s], on average."""
    usb_timer: float = Field(default=0.0, ge=0.0, le=0.255)
    """Latency timer of a USB serial adapter, towards the host only [s]: 0.016 as shipped, 0.001 at best, 0 without."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        span = self.latency_max - self.latency_min
        if not 0.0 < self.latency_mean - self.latency_min < 0.5 * span:
            raise ValueError(
                f"latency_mean {self.latency_mean} must lie between latency_min {self.latency_min} and half way to "
                f"latency_max {self.latency_max}"
            )
        return self


class RadioConfig(Section):
    """Both directions."""

    to_board: ChannelConfig = ChannelConfig()
    """Host to aircraft."""
    to_host: ChannelConfig = ChannelConfig(usb_timer=0.001)
    """Aircraft to host."""
