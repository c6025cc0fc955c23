"""Facts of the FlightCtrl's active parameter set that the checks before a flight need."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

OPEN_ABOVE: Final = 128
"""The pilot's gate, the parameter ExternalControl, is open while its value is above this: up to 128 it is shut, 248 to
255 are a channel of the transmitter, a constant above 128 holds it open for good. docs/firmware-notes, section 6."""


class GateKind(Enum):
    """Kind of value of ExternalControl in the active set."""

    UNKNOWN = auto()
    """It cannot be read here; the pilot's own check decides."""
    CHANNEL = auto()
    """A channel of the transmitter."""
    CONSTANT = auto()
    """A number."""


@dataclass(frozen=True, slots=True)
class Gate:
    """The gate as it was read.

    Attributes:
        kind: what it is.
        value: ExternalControl, 0..255; 0 where it is unknown.
        altitude_channel: receiver channel by which the same switch also turns height control on and off; None where
            it does not.
    """

    kind: GateKind
    value: int = 0
    altitude_channel: int | None = None


@dataclass(frozen=True, slots=True)
class KnownSet:
    """The active set as it was read.

    Attributes:
        gate: the pilot's switch.
        name: of the set; empty where the set could not be read, and all else is unknown then.
        has_height_control: height control can be switched on (GlobalConfig bit 0).
        emergency_throttle: NotGas [count of 254]; None where it is a share of the hover throttle the board has learnt.
        emergency_time: NotGasZeit; at zero the motors stop when the receiver is lost.
        low_cell: voltage of a cell below which the FlightCtrl warns [V]; None where the set gives that of the battery.
    """

    gate: Gate
    name: str = ""
    has_height_control: bool = False
    emergency_throttle: int | None = None
    emergency_time: int = 0
    low_cell: float | None = None

    def low_voltage(self, cells: int | None) -> float:
        """Voltage below which a battery with this number of cells (None: unknown) is low [V]; zero if unknown."""
        return 0.0 if self.low_cell is None else self.low_cell * (cells or 1)

    @property
    def is_known(self) -> bool:
        """Whether the set could be read."""
        return bool(self.name)


UNREAD: Final = KnownSet(Gate(GateKind.UNKNOWN))
"""Nothing has been read."""
