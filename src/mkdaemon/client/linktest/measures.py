"""Figures of a measurement of the line: percentiles, the weighted average, histogram, losses over time. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Final

from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.telemetry.link import Fates

WEIGHT: Final = 1 / 8
"""Weight of a new round trip in the weighted average: that of the daemon's own `mean_ms`, and of TCP (RFC 6298,
section 2)."""


@dataclass(frozen=True, slots=True)
class LoadRun:
    """What was measured under one load.

    Attributes:
        label: whose line: name of the radio, the cable, the place.
        load: `light`, `full`, `chosen`.
        control_hz: stick frames a second that left [Hz]; 0 for none.
        probes: every probe whose fate is known, in the order in which they were sent.
        line_share: largest share of the line that was used in either direction, over a second [0..1]; None where it is
            not known.
        damaged: bytes that arrived and were no frame; None where it is not known.
        counted: what the daemon says became of the link tests, requests and stick frames of this time.
        stalled: part of the time in which the daemon itself did not run [0..1].
    """

    label: str
    load: str
    control_hz: float
    probes: tuple[Probe, ...]
    line_share: float | None = None
    damaged: int | None = None
    counted: Mapping[str, Fates] = field(default_factory=dict)
    stalled: float = 0.0

    def of(self, kind: ProbeKind) -> list[Probe]:
        """Its probes of one kind."""
        return [probe for probe in self.probes if probe.kind is kind]


@dataclass(frozen=True, slots=True)
class Measures:
    """Figures of the probes of one kind.

    Attributes:
        sent: probes whose fate is known.
        lost: of these, without an answer in time.
        replaced: of the lost ones, those where the board confirms only a newer frame.
        least_ms: shortest round trip [ms]; like all of them None where nothing was answered.
        mean_ms: arithmetic mean [ms].
        weighted_ms: weighted average at the end: every new round trip counts an eighth [ms].
        weighted_most_ms: its largest value on the way [ms].
        p50_ms: median [ms].
        p95_ms: 95th percentile [ms].
        p99_ms: 99th percentile [ms].
        most_ms: longest [ms].
        mean_run: losses in a row, on average; 0 where none was lost.
        longest_run: most losses in a row.
        silence: longest time without an answered probe between two answered ones [s].
    """

    sent: int
    lost: int
    replaced: int
    least_ms: float | None
    mean_ms: float | None
    weighted_ms: float | None
    weighted_most_ms: float | None
    p50_ms: float | None
    p95_ms: float | None
    p99_ms: float | None
    most_ms: float | None
    mean_run: float
    longest_run: int
    silence: float

    @property
    def loss_percent(self) -> float:
        """100 * lost / sent [%]; 0 where nothing was sent."""
        return 100 * self.lost / self.sent if self.sent else 0.0

    @property
    def line_loss_percent(self) -> float:
        """The same without what the board replaced, which says nothing about the line [%]."""
        return 100 * (self.lost - self.replaced) / self.sent if self.sent else 0.0


def measure(probes: Sequence[Probe]) -> Measures:
    """Sum up probes of one kind, in the order in which they were sent."""
    trips = [1000 * probe.trip for probe in probes if probe.trip is not None]
    ordered = sorted(trips)
    averages = weighted_averages(trips)
    runs = runs_of_losses(probes)
    answered = [probe.sent for probe in probes if probe.trip is not None]
    gaps = [after - before for before, after in pairwise(answered)]
    return Measures(
        sent=len(probes),
        lost=len(probes) - len(trips),
        replaced=sum(probe.is_replaced and probe.trip is None for probe in probes),
        least_ms=ordered[0] if ordered else None,
        mean_ms=sum(trips) / len(trips) if trips else None,
        weighted_ms=averages[-1] if averages else None,
        weighted_most_ms=max(averages, default=None),
        p50_ms=percentile(ordered, 0.50),
        p95_ms=percentile(ordered, 0.95),
        p99_ms=percentile(ordered, 0.99),
        most_ms=ordered[-1] if ordered else None,
        mean_run=sum(runs) / len(runs) if runs else 0.0,
        longest_run=max(runs, default=0),
        silence=max(gaps, default=0.0),
    )


def percentile(ordered: Sequence[float], share: float) -> float | None:
    """Nearest-rank percentile of ascending values; None of none."""
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)] if ordered else None


def weighted_averages(trips: Iterable[float]) -> list[float]:
    """The weighted average after each round trip: it begins with the first, then every new one counts `WEIGHT`."""
    found: list[float] = []
    for trip in trips:
        found.append(found[-1] + WEIGHT * (trip - found[-1]) if found else trip)
    return found


def runs_of_losses(probes: Sequence[Probe]) -> list[int]:
    """How many probes in a row were lost, each time some were."""
    groups = groupby(probes, key=lambda probe: probe.trip is None)
    return [sum(1 for _ in group) for is_lost, group in groups if is_lost]


def histogram(trips_ms: Sequence[float], width_ms: float, bins: int) -> list[int]:
    """Count round trips by length.

    Args:
        trips_ms: [ms].
        width_ms: of a bin [ms].
        bins: how many; the last one also has everything that is longer.
    """
    counts = [0] * bins
    for trip in trips_ms:
        counts[min(int(trip / width_ms), bins - 1)] += 1
    return counts


def losses_over_time(probes: Sequence[Probe], seconds: float, slices: int) -> list[float | None]:
    """Share of lost probes in each of equal parts of the time [0..1]; None where none was sent.

    Args:
        probes: of one kind.
        seconds: how long it was measured [s].
        slices: how many parts.
    """
    sent, lost = [0] * slices, [0] * slices
    for probe in probes:
        place = min(int(slices * probe.sent / seconds), slices - 1) if seconds > 0 else 0
        sent[place] += 1
        lost[place] += probe.trip is None
    return [gone / count if count else None for gone, count in zip(lost, sent, strict=True)]
