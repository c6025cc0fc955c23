"""Where a FlightCtrl's memory holds external control, by generation; facts of its `uart.h`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from lab.hil.build import Firmware
from lab.hil.chip import Chip
from mkdaemon.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Control:
    """External control as a generation lays it out.

    Attributes:
        symbol: name of the variable.
        pitch: byte of the pitch command; roll and yaw follow it, and the throttle follows them.
        config: byte whose lowest bit says that it is valid.
        size: of the variable [byte].
        throttle: format of the throttle; unsigned where older firmware takes counts of its own stick, 0 to 255.
    """

    symbol: str
    pitch: int
    config: int
    size: int
    throttle: str

    def held(self, chip: Chip) -> tuple[int, int, int, int, bool]:
        """What the firmware holds: pitch, roll, yaw, throttle, whether it is valid."""
        pitch, roll, yaw = (chip.peek(self.symbol, "<b", self.pitch + place) for place in range(3))
        throttle = chip.peek(self.symbol, self.throttle, self.pitch + 3)
        return pitch, roll, yaw, throttle, bool(chip.peek(self.symbol, "<B", self.config) & 1)


GENERATIONS: Final = (
    Control("ExternalControl", pitch=0, config=5, size=7, throttle="<b"),
    Control("ExternControl", pitch=3, config=10, size=11, throttle="<B"),
)
"""Seven bytes since 0.90, and eleven with two digital inputs and a height before."""


def control_of(firmware: Firmware) -> Control:
    """How this firmware lays external control out.

    Raises:
        ConfigError: it has no external control.
    """
    for generation in GENERATIONS:
        if generation.symbol in firmware.symbols:
            return generation
    names = " nor ".join(one.symbol for one in GENERATIONS)
    raise ConfigError(f"firmware {firmware.name} has neither {names} among its variables: it takes no external control")
