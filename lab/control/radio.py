"""One direction of the serial line with a radio in it: serialised bytes, latency, bursts of loss."""

from __future__ import annotations

import random
from dataclasses import dataclass

BAUD = 57600
"""[baud]."""
IN_BURST = 0.6
"""Share of the packets of a bad stretch that are lost."""
RECOVERY = 0.25
"""Share of packets after which a bad stretch ends: four packets on average."""


@dataclass(frozen=True, slots=True)
class RadioModel:
    """Latency and loss; source: docs/lab/control.md, "Simulator".

    Attributes:
        fastest: [s].
        slowest: of ordinary packets [s].
        spikes: share of packets that take up to `spike`.
        spike: [s].
        loss: share of packets lost (Gilbert and Elliott's model).
    """

    fastest: float = 0.012
    slowest: float = 0.025
    spikes: float = 0.03
    spike: float = 0.062
    loss: float = 0.01


class Radio:
    """A direction in use."""

    def __init__(self, model: RadioModel, rng: random.Random) -> None:
        self._model, self._rng = model, rng
        self._busy = self._last = 0.0
        self._is_bad = False

    def arrival(self, now: float, size: int) -> float | None:
        """When a packet of so many bytes arrives [s]; None for never."""
        model, rng = self._model, self._rng
        self._busy = max(now, self._busy) + size * 10 / BAUD
        share = model.loss / IN_BURST
        enters = RECOVERY * share / (1 - share)
        self._is_bad = rng.random() > RECOVERY if self._is_bad else rng.random() < enters
        if self._is_bad and rng.random() < IN_BURST:
            return None
        is_spike = rng.random() < model.spikes
        low, high = (model.slowest, model.spike) if is_spike else (model.fastest, model.slowest)
        self._last = max(self._busy + rng.uniform(low, high), self._last + 1e-4)
        return self._last
