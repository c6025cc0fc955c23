"""A lithium-polymer pack that sags under load and runs empty."""

from __future__ import annotations

from bisect import bisect_right
from typing import Final

from mksim.config import BatteryConfig

OPEN_CIRCUIT_V: Final = (
    (0.00, 3.00),
    (0.05, 3.45),
    (0.10, 3.60),
    (0.20, 3.70),
    (0.40, 3.78),
    (0.60, 3.88),
    (0.80, 4.02),
    (1.00, 4.20),
)
"""State of charge against cell voltage at rest [V]: the usual LiPo curve, flat in the middle with a knee at 10 %."""

_CHARGES: Final = tuple(charge for charge, _ in OPEN_CIRCUIT_V)


def open_circuit_voltage(charge: float) -> float:
    """Return the cell voltage at rest [V] of a state of charge, 0..1; held at the ends."""
    if charge <= 0.0:
        return OPEN_CIRCUIT_V[0][1]
    if charge >= 1.0:
        return OPEN_CIRCUIT_V[-1][1]
    i = bisect_right(_CHARGES, charge)
    (low, low_v), (high, high_v) = OPEN_CIRCUIT_V[i - 1], OPEN_CIRCUIT_V[i]
    return low_v + (high_v - low_v) * (charge - low) / (high - low)


class SimulatedBattery:
    """Voltage, current and used capacity.

    Attributes:
        voltage: at the terminals, under load [V].
        current: [A].
        used_mah: drawn since the start [mAh].
        drop: voltage taken off by a fault [V].
        is_low: the pilot lands.
    """

    __slots__ = (
        "_cells",
        "_charge0",
        "_config",
        "_low_v",
        "_resistance",
        "current",
        "drop",
        "is_low",
        "used_mah",
        "voltage",
    )

    def __init__(self, config: BatteryConfig) -> None:
        self._config = config
        self._cells = config.cells
        self._charge0 = config.charge
        self._resistance = config.cells * config.cell_resistance
        self._low_v = config.cells * config.low_cell_v
        self.used_mah = 0.0
        self.drop = 0.0
        self.current = config.avionics_current
        self.voltage = self._cells * open_circuit_voltage(config.charge) - self.current * self._resistance
        self.is_low = self.voltage < self._low_v

    @property
    def charge(self) -> float:
        """State of charge, 0..1."""
        return max(0.0, self._charge0 - self.used_mah / self._config.capacity_mah)

    def update(self, load: float, dt: float) -> None:
        """Draw current for `dt` [s].

        Args:
            load: electrical power of the motors over that of hover.
            dt: [s].
        """
        self.current = self._config.avionics_current + self._config.hover_current * load
        self.used_mah += self.current * dt / 3.6
        resting = self._cells * open_circuit_voltage(self.charge)
        self.voltage = max(0.5, resting - self.current * self._resistance - self.drop)
        self.is_low = self.voltage < self._low_v
