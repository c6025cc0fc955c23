"""Measurements of a line as a picture (SVG): how long answers take, and when they were lost. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final
from xml.sax.saxutils import escape

from mkdaemon.client.linktest.measures import LoadRun, Measures, histogram, losses_over_time, measure
from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.spelling import on_one_line

WIDTH: Final = 900
ROW: Final = 230
TOP: Final = 58
BINS: Final = 48
SLICES: Final = 48
_LEFT, _RIGHT, _PLOT, _HIGH = 62, 520, 350, 120
_COLOURS: Final = {ProbeKind.ECHO: "#1f6fb4", ProbeKind.CONTROL: "#d9822b"}
_STYLE: Final = (
    "text{font:13px sans-serif;fill:#222}.t{font-weight:bold}.n{font-size:11px;fill:#555}.a{stroke:#888;fill:none}"
    ".g{stroke:#e4e4e4}.m{stroke:#222;stroke-dasharray:3 3}.w{stroke:#b00;stroke-width:1.5}"
)


def link_picture(runs: Sequence[LoadRun], title: str) -> str:
    """Draw each load of one link, or of two beside each other, in a separate row.

    Args:
        runs: what was measured; all rows have one scale.
        title: above them.

    Returns:
        The SVG.
    """
    scale = _scale(runs)
    height = TOP + ROW * len(runs) + 10
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}">',
        f'<style>{_STYLE}</style><rect width="{WIDTH}" height="{height}" fill="#fff"/>',
        f'<text x="14" y="24" class="t">{_words(title)}</text>',
        *_legend(),
    ]
    for number, run in enumerate(runs):
        parts += _row(run, TOP + ROW * number, scale)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _words(text: str) -> str:
    return escape(on_one_line(text))


def _scale(runs: Sequence[LoadRun]) -> float:
    """Right end of all histograms [ms]: a round number above 99.5 of 100 round trips."""
    trips = sorted(1000 * probe.trip for run in runs for probe in run.probes if probe.trip is not None)
    most = trips[int(0.995 * len(trips))] if trips else 1.0
    step: float = 10.0 ** math.floor(math.log10(max(most, 1.0)))
    return next(step * factor for factor in (1, 1.2, 1.6, 2, 2.4, 3.2, 4, 4.8, 6.4, 8, 10) if step * factor >= most)


def _legend() -> Iterator[str]:
    for place, (kind, colour) in enumerate(_COLOURS.items()):
        x = 14 + 110 * place
        yield f'<rect x="{x}" y="36" width="12" height="12" fill="{colour}" fill-opacity="0.6"/>'
        yield f'<text x="{x + 17}" y="47">{kind}s</text>'
    yield '<path class="m" d="M250,36V48"/><text x="257" y="47">50, 95, 99 of 100 link tests</text>'
    yield '<path class="w" d="M470,36V48"/><text x="477" y="47">weighted average of link tests</text>'


def _row(run: LoadRun, top: float, scale: float) -> Iterator[str]:
    found = {kind: measure(run.of(kind)) for kind in ProbeKind if run.of(kind)}
    control = f", {run.control_hz:g} stick frames a second" if run.control_hz else ""
    yield f'<text x="14" y="{top + 16}" class="t">{_words(run.label)}, {_words(run.load)} load{control}</text>'
    for line, (kind, figures) in enumerate(found.items()):
        yield f'<text x="14" y="{top + 34 + 15 * line}" class="n">{kind}s: {_figures(figures)}</text>'
    bottom = top + 60 + _HIGH
    yield from _frame(_LEFT, bottom, "round trip [ms]", [scale * part / 4 for part in range(5)])
    yield from _histograms(run, found, bottom, scale)
    seconds = max((probe.sent for probe in run.probes), default=0.0)
    yield from _frame(_RIGHT, bottom, "lost over time [s]", [seconds * part / 4 for part in range(5)])
    yield from _losses(run, found, bottom, seconds)


def _figures(figures: Measures) -> str:
    if figures.p50_ms is None or figures.weighted_ms is None:
        return f"{figures.sent} sent, none answered"
    return (
        f"{figures.sent} sent, {figures.loss_percent:.2f} % lost; 50 / 95 / 99 of 100 within {figures.p50_ms:.1f} / "
        f"{figures.p95_ms:.1f} / {figures.p99_ms:.1f} ms; weighted average {figures.weighted_ms:.1f} ms"
    )


def _frame(left: float, bottom: float, title: str, ticks: Sequence[float]) -> Iterator[str]:
    yield f'<path class="a" d="M{left},{bottom - _HIGH}V{bottom}H{left + _PLOT}"/>'
    for part, tick in enumerate(ticks):
        x = left + _PLOT * part / (len(ticks) - 1)
        yield f'<text x="{x:.1f}" y="{bottom + 15}" class="n" text-anchor="middle">{tick:.3g}</text>'
    yield f'<text x="{left + _PLOT / 2}" y="{bottom + 30}" class="n" text-anchor="middle">{title}</text>'


def _bars(left: float, bottom: float, shares: Sequence[float | None], colour: str) -> Iterator[str]:
    """Bars whose heights are shares of the plot's [0..1]."""
    width = _PLOT / len(shares)
    for place, share in enumerate(shares):
        if share:
            x, high = left + width * place, _HIGH * share
            yield (
                f'<rect x="{x:.1f}" y="{bottom - high:.1f}" width="{width - 1:.1f}" height="{high:.1f}" '
                f'fill="{colour}" fill-opacity="0.6"/>'
            )


def _histograms(run: LoadRun, found: dict[ProbeKind, Measures], bottom: float, scale: float) -> Iterator[str]:
    counts = {kind: histogram(_trips(run.of(kind)), scale / BINS, BINS) for kind in found}
    highest = max((count / max(sum(bins), 1) for bins in counts.values() for count in bins), default=0.0) or 1.0
    yield f'<text x="{_LEFT - 6}" y="{bottom - _HIGH + 5}" class="n" text-anchor="end">{100 * highest:.0f} %</text>'
    for kind, bins in counts.items():
        shares = [count / max(sum(bins), 1) / highest for count in bins]
        yield from _bars(_LEFT, bottom, shares, _COLOURS[kind])
    if (echo := found.get(ProbeKind.ECHO)) is None:
        return
    for style, value in (("m", echo.p50_ms), ("m", echo.p95_ms), ("m", echo.p99_ms), ("w", echo.weighted_ms)):
        if value is not None:
            x = _LEFT + _PLOT * min(value / scale, 1.0)
            yield f'<path class="{style}" d="M{x:.1f},{bottom - _HIGH}V{bottom}"/>'


def _losses(run: LoadRun, found: dict[ProbeKind, Measures], bottom: float, seconds: float) -> Iterator[str]:
    series = {kind: losses_over_time(run.of(kind), seconds, SLICES) for kind in found}
    most = max((share for shares in series.values() for share in shares if share), default=0.0)
    top = next(limit for limit in (0.05, 0.1, 0.2, 0.5, 1.0) if most <= limit)
    yield f'<text x="{_RIGHT - 6}" y="{bottom - _HIGH + 5}" class="n" text-anchor="end">{100 * top:.0f} %</text>'
    for kind, shares in series.items():
        yield from _bars(_RIGHT, bottom, [None if share is None else share / top for share in shares], _COLOURS[kind])


def _trips(probes: Sequence[Probe]) -> list[float]:
    return [1000 * probe.trip for probe in probes if probe.trip is not None]
