"""The plots of a report as figures of plotly.js: plain maps that become JSON.

Texts of others are escaped here as well: plotly takes a part of HTML in texts, links among it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any, Final, NamedTuple

import numpy as np

from mkdaemon.reading import EventLine, Sort
from mkdaemon.view.report.flight import RecordedFlight
from mkdaemon.view.report.pieces import Piece
from mkdaemon.view.report.timeseries import Array, thin

BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#1f6fb4", "#d9822b", "#2a9d62", "#c0392b", "#7b52ab", "#7d8590"
DASHED: Final = "dash"
LONGEST_GAP: Final = 2.0
"""A line is broken where nothing came for longer [s], and for ten times as long as usual."""
TRACK_POINTS: Final = 2000
MOST_BANDS: Final = 80
"""Manoeuvres that are shaded."""
LETTERS: Final = 110
"""That fit into the width of a plot."""
MOST_EVENTS: Final = 1500
"""Events that are drawn."""


Lines = list[dict[str, Any]]
"""Traces of one plot."""


@dataclass(frozen=True, slots=True)
class Plot:
    """One figure.

    Attributes:
        name: of its place in the page.
        title: above it.
        data: traces.
        layout: of plotly.
        times: of the points of the first trace [s], of a track; empty for a plot over time.
        is_alone: its axis is no time of the flight: it follows no other plot.
    """

    name: str
    title: str
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    times: list[float] = field(default_factory=list)
    is_alone: bool = False

    def as_json(self) -> dict[str, Any]:
        """For the script of the page."""
        shown = {"name": self.name, "data": self.data, "layout": self.layout, "times": self.times}
        return shown | {"alone": self.is_alone}


def plots_of(flight: RecordedFlight, pieces: Sequence[Piece]) -> list[Plot]:
    """Every plot that the flight has numbers for: tracks first, then over time."""
    over_time = [plot for plot in _over_time(flight) if plot.data]
    events = _events(flight.happenings, pieces, flight.ended - flight.began)
    timed = [events, *over_time] if events.data else over_time
    limits = [flight.began, max(flight.ended, flight.began + 1e-3)]
    for plot in timed:
        plot.layout["xaxis"] |= {"range": limits}
        plot.layout["shapes"] = [*_bands(pieces), *_gaps(flight)]
    return [*_tracks(flight), *timed]


# -- over time --------------------------------------------------------------------------------------------------------


class Curve(NamedTuple):
    """A series in a plot over time.

    Attributes:
        series: its name; `LEVEL` for the horizontal error.
        name: in the legend.
        colour: of the line.
        dash: of the line.
        factor: by which the numbers are multiplied.
        unless: a series beside which this one is not drawn.
        is_seen: broken in blind flight: a calculation has no error.
    """

    series: str
    name: str
    colour: str
    dash: str = "solid"
    factor: float = 1.0
    unless: str = ""
    is_seen: bool = False


class Panel(NamedTuple):
    """A plot over time.

    Attributes:
        name: of its place in the page.
        title: above it.
        unit: of its axis.
        height: of it [px].
        curves: in it.
    """

    name: str
    title: str
    unit: str
    height: int
    curves: tuple[Curve, ...]


LEVEL: Final = "error.level"
_HEIGHT: Final = (
    Curve("estimate.z", "estimate, over the target", BLUE),
    Curve("goal.z", "goal", ORANGE, DASHED),
    Curve("barometer", "barometer, over the start", GREY),
    Curve("ground.z", "position, over home", PURPLE, unless="barometer"),
    Curve("truth.z", "true, over the ground", GREEN, "dot"),
)
_ERROR: Final = (
    Curve(LEVEL, "horizontal", BLUE, factor=100.0, is_seen=True),
    Curve("error.z", "height, above positive", ORANGE, factor=100.0, is_seen=True),
)
_PLACE: Final = (
    Curve("estimate.x", "x", BLUE),
    Curve("goal.x", "x, goal", BLUE, DASHED),
    Curve("estimate.y", "y", ORANGE),
    Curve("goal.y", "y, goal", ORANGE, DASHED),
)
_ATTITUDE: Final = (
    Curve("attitude.roll", "roll, right side down", BLUE),
    Curve("attitude.pitch", "pitch, nose down", ORANGE),
)
_STICKS: Final = (
    *(Curve(f"stick.{axis}", axis, colour) for axis, colour in (("pitch", ORANGE), ("roll", BLUE), ("yaw", GREEN))),
    Curve("stick.throttle", "throttle", PURPLE),
    Curve("pilot.throttle", "the pilot's throttle", GREY, DASHED),
)
_LINK: Final = (
    Curve("link.echo_p50", "link test, p50", GREEN),
    Curve("link.echo_p95", "link test, p95", BLUE),
    Curve("link.confirm_p95", "stick frames, p95", ORANGE),
)
_LOSS: Final = (Curve("link.echo_loss", "link test", BLUE), Curve("link.confirm_loss", "stick frames", ORANGE))
_BATTERY: Final = (Curve("battery.voltage", "voltage [V]", GREEN), Curve("battery.current", "current [A]", GREY))
PANELS: Final = (
    Panel("height", "Height", "m", 240, _HEIGHT),
    Panel("error", "Error to the goal", "cm", 220, _ERROR),
    Panel("place", "Place over the target", "m", 220, _PLACE),
    Panel("attitude", "Attitude", "deg", 200, _ATTITUDE),
    Panel("sticks", "Sticks sent", "count", 200, _STICKS),
    Panel("link", "Link: round trips", "ms", 200, _LINK),
    Panel("loss", "Link: losses", "%", 160, _LOSS),
    Panel("battery", "Battery", "V, A", 180, _BATTERY),
)
"""Every plot over time; those of cameras come before the last."""


def _panels(flight: RecordedFlight) -> Iterable[Panel]:
    yield from PANELS[:-1]
    for place, camera in enumerate(flight.cameras):
        curves = (
            Curve(f"{camera} eyes.latency_p50", "latency, p50 [ms]", BLUE),
            Curve(f"{camera} eyes.latency_p99", "latency, p99 [ms]", ORANGE),
            Curve(f"{camera} eyes.posed", "with a pose [%]", GREEN),
        )
        yield Panel(f"eyes{place}", f"Camera {camera}: latency, and images with a pose", "ms, %", 200, curves)
    yield PANELS[-1]


def _over_time(flight: RecordedFlight) -> Iterable[Plot]:
    for panel in _panels(flight):
        drawn = [trace for curve in panel.curves if (trace := _drawn(flight, curve)) is not None]
        yield _timed(panel.name, panel.title, panel.unit, drawn, panel.height)


def _drawn(flight: RecordedFlight, curve: Curve) -> dict[str, Any] | None:
    """A curve as a trace; None where there is no such series."""
    found = [flight.series.get(name) for name in (("error.x", "error.y") if curve.series == LEVEL else (curve.series,))]
    parts = [series.arrays() for series in found if series is not None]
    if len(parts) < len(found) or flight.has(curve.unless):
        return None
    values = np.hypot(*(values for _, values in parts)) if curve.series == LEVEL else parts[0][1]
    times, values = thin(parts[0][0], curve.factor * values)
    if curve.is_seen:
        values = np.where(flight.is_blind(times), math.nan, values)
    return _trace(times, values, curve.name, curve.colour, curve.dash)


def _trace(times: Array, values: Array, name: str, colour: str, dash: str = "solid") -> dict[str, Any]:
    x: list[float | None] = []
    y: list[float | None] = []
    steps = np.diff(times)
    longest = max(LONGEST_GAP, 10.0 * float(np.median(steps)) if len(steps) else 0.0)
    for place, (at, value) in enumerate(zip(times.tolist(), values.tolist(), strict=True)):
        if place and steps[place - 1] > longest:
            x.append(round(at - 1e-3, 3))
            y.append(None)
        x.append(round(at, 3))
        y.append(None if math.isnan(value) else round(value, 4))
    line = {"color": colour, "width": 1.5, "dash": dash}
    return _scatter("lines" if len(times) > 1 else "markers", escape(name), x, y, line=line, marker={"color": colour})


def _scatter(mode: str, name: str, x: Sequence[float | None], y: Sequence[object], **more: Any) -> dict[str, Any]:
    """A trace of plotly; its texts are escaped already."""
    return {"type": "scatter", "mode": mode, "name": name, "x": x, "y": y, **more}


def _timed(name: str, title: str, unit: str, data: list[dict[str, Any]], height: int = 200) -> Plot:
    layout = {
        "height": height,
        "hovermode": "x unified",
        "xaxis": {"ticksuffix": " s", "hoverformat": ".2f"},
        "yaxis": {"title": {"text": unit}, "hoverformat": ".3~f", "zeroline": False},
    }
    return Plot(name, title, data, layout)


def _gaps(flight: RecordedFlight) -> list[dict[str, Any]]:
    """Blind flight, the same in every plot."""
    return [
        {**_BAND, "x0": round(begin, 3), "x1": round(end, 3), "fillcolor": "rgba(192,57,43,0.18)"}
        for begin, end in flight.gaps[:MOST_BANDS]
    ]


_BAND: Final = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below", "line": {"width": 0}}


def _bands(pieces: Sequence[Piece]) -> list[dict[str, Any]]:
    """Every second manoeuvre or stage shaded."""
    return [
        {**_BAND, "x0": round(piece.begin, 3), "x1": round(piece.end, 3), "fillcolor": "rgba(31,111,180,0.07)"}
        for piece in pieces[:MOST_BANDS:2]
    ]


_COLOURS: Final = {
    Sort.REFUSAL: RED,
    Sort.FAILSAFE: RED,
    Sort.WARNING: ORANGE,
    Sort.MARK: PURPLE,
    Sort.MODE: GREEN,
}
_FLOWN: Final = "flown"


def _events(happenings: Sequence[EventLine], pieces: Sequence[Piece], length: float) -> Plot:
    """What was flown and what happened, one row for each sort, in a recording of some length [s]."""
    data: Lines = [_flown(pieces)] if pieces else []
    for sort in Sort:
        found = [one for one in happenings if one.sort is sort][:MOST_EVENTS]
        if found:
            words = [escape(one.text[:100]) for one in found]
            data.append(_marks(sort.value, [round(one.at, 3) for one in found], words, _COLOURS.get(sort, GREY)))
    plot = _timed("events", "Manoeuvres and events", "", data, 60 + 26 * len(data))
    plot.layout.update(showlegend=False, hovermode="closest")
    plot.layout["yaxis"] = {"autorange": "reversed", "type": "category"}
    plot.layout["annotations"] = _names(pieces, length)
    return plot


def _flown(pieces: Sequence[Piece]) -> dict[str, Any]:
    """A bar for each manoeuvre or stage, as wide as it lasted."""
    x: list[float | None] = []
    text: list[str | None] = []
    for piece in pieces:
        words = escape(f"{piece.name}, {piece.begin:.1f} to {piece.end:.1f} s")
        x += [round(piece.begin, 3), round(piece.end, 3), None]
        text += [words, words, None]
    line, hover = {"color": "#8fb8da", "width": 14}, "%{text}<extra></extra>"
    return _scatter("lines", _FLOWN, x, [_FLOWN] * len(x), text=text, line=line, hovertemplate=hover)


def _names(pieces: Sequence[Piece], length: float) -> list[dict[str, Any]]:
    """The names of manoeuvres on their bars, as far as they have room."""
    place = {"y": _FLOWN, "xanchor": "left", "showarrow": False, "font": {"size": 11}}
    found = []
    for piece in pieces[:MOST_BANDS]:
        room = LETTERS * (piece.end - piece.begin) / max(length, 1e-3)
        name = next((name for name in (piece.name, piece.manoeuvre) if len(name) < room), "")
        if name:
            found.append({**place, "x": round(piece.begin, 3), "text": escape(name)})
    return found


def _marks(row: str, x: list[float], text: list[str], colour: str) -> dict[str, Any]:
    marker, hover = {"color": colour, "size": 9, "symbol": "diamond"}, "%{x:.2f} s: %{text}<extra></extra>"
    return _scatter("markers", row, x, [row] * len(x), text=text, marker=marker, hovertemplate=hover)


# -- from above -------------------------------------------------------------------------------------------------------


def _tracks(flight: RecordedFlight) -> list[Plot]:
    found: list[Plot] = []
    if flight.has("estimate.x"):
        track = _track(flight, "target", "Over the target", "estimate", "estimate", ("x", "y"))
        goal = _path(flight, "goal")
        if goal is not None:
            _, x, y = goal
            line = {"color": ORANGE, "width": 1.2, "dash": DASHED}
            track.data.insert(1, _scatter("lines", "goal", x, y, line=line, hoverinfo="skip"))
        found.append(track)
    if flight.has("truth.x"):
        found.append(_track(flight, "ground", "Over the ground", "truth", "true", ("east", "north")))
    elif flight.has("ground.x"):
        found.append(_track(flight, "ground", "Over the ground", "ground", "position", ("east", "north")))
    return found


def _path(flight: RecordedFlight, name: str) -> tuple[list[float], list[float], list[float]] | None:
    """Times, x and y of a track, thinned to `TRACK_POINTS`."""
    if not (flight.has(f"{name}.x") and flight.has(f"{name}.y")):
        return None
    (times, x), (_, y) = flight.series[f"{name}.x"].arrays(), flight.series[f"{name}.y"].arrays()
    step = math.ceil(len(times) / TRACK_POINTS)
    kept = [times[::step], x[::step], y[::step]]
    return tuple(np.round(one, 4).tolist() for one in kept)


def _track(flight: RecordedFlight, name: str, title: str, series: str, words: str, axes: tuple[str, str]) -> Plot:
    path = _path(flight, series)
    assert path is not None
    times, x, y = path
    hover = "%{customdata:.2f} s: %{x:.3f}, %{y:.3f} m<extra></extra>"
    line = _scatter(*("lines", words, x, y), customdata=times, line={"color": BLUE, "width": 1.8}, hovertemplate=hover)
    silent: dict[str, Any] = {"hoverinfo": "skip", "showlegend": False}
    coloured = {"color": [GREEN, RED], "size": 9}
    ends = _scatter("markers+text", "begin and end", [x[0], x[-1]], [y[0], y[-1]], marker=coloured, **silent)
    ends |= {"text": ["begin", "end"], "textposition": "top center"}
    ring = {"color": PURPLE, "size": 12, "symbol": "circle-open", "line": {"width": 3}}
    here = _scatter("markers", "here", [], [], marker=ring, **silent)
    layout = {
        "height": 460,
        "hovermode": "closest",
        "xaxis": {"title": {"text": f"{axes[0]} [m]"}},
        "yaxis": {"title": {"text": f"{axes[1]} [m]"}, "scaleanchor": "x", "scaleratio": 1},
    }
    return Plot(name, title, [line, ends, here], layout, times)
