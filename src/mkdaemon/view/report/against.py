"""The cameras of a flight against a reference, as a chapter of its report: sentences, tables, figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from mkdaemon.errors import ConfigError
from mkdaemon.view.report.alignment import Group, PoseTrack
from mkdaemon.view.report.baseline import (
    LENGTHS,
    Baseline,
    Bin,
    DropOut,
    NoAnswer,
    Offset,
    PairErrors,
    Spread,
    compare,
    drop_outs,
)
from mkdaemon.view.report.flight import RecordedFlight
from mkdaemon.view.report.plots import BLUE, GREEN, ORANGE, RED, Plot
from mkdaemon.view.report.sights import OWN_FRAME, Sights
from mkdaemon.view.report.timeseries import Array

DOTS: Final = 1500
"""Pairs that a figure shows."""
_CM: Final = 100.0
_MS: Final = 1000.0
_SPREADS: Final = ("along (cm)", "across (cm)", "rotation (deg)")


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table.

    Attributes:
        title: above it.
        head: of its columns.
        rows: of texts; the first is a word, the others are numbers.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class Chapter:
    """A camera against a reference.

    Attributes:
        camera: its name.
        reference: name of the reference.
        is_answered: the recording has an answer; if not, the sentences say why and what to do.
        sentences: findings first.
        sheets: tables.
        plots: figures.
    """

    camera: str
    reference: str
    is_answered: bool
    sentences: Sequence[str]
    sheets: Sequence[TextTable] = ()
    plots: Sequence[Plot] = field(default=())


def chapters_of(flight: RecordedFlight, reference: str, path: Path) -> list[Chapter]:
    """Each camera, and each other source, against a reference.

    Args:
        flight: read with its sights.
        reference: name of a source of poses, or of a camera.
        path: of the recording, for errors.

    Raises:
        ConfigError: the recording has no poses of the reference, or of nothing else.
    """
    with_poses = sorted(name for name, sights in flight.sights.items() if sights.poses)
    known = ", ".join(with_poses[:20]) or "none"
    if reference not in with_poses:
        fix = "check `name` in [[positions]], and that its sender ran (mkctl watch 'positions/*')"
        raise ConfigError(f"{path}: no poses by {reference}; it has poses by: {known}; {fix}")
    others = [name for name in with_poses if name != reference]
    if not others:
        raise ConfigError(f"{path}: only {reference} has poses; record with a camera that sees its target")
    return [
        _chapter(name, flight.sights[name], reference, flight.sights[reference], place)
        for place, name in enumerate(others)
    ]


def _chapter(camera: str, mine: Sights, reference: str, theirs: Sights, place: int) -> Chapter:
    shared = [target for target in mine.poses if target in theirs.poses and target != OWN_FRAME]
    target = max(shared or mine.poses, key=lambda name: len(mine.poses[name]))
    other = target if shared else max(theirs.poses, key=lambda name: len(theirs.poses[name]))
    track, base, sight = mine.track(target), theirs.track(other), mine.sight(target)
    found = compare(track, base, sight, mine.images(target))
    if isinstance(found, NoAnswer):
        return Chapter(camera, reference, False, [found.reason])
    against = f"target {target or 'in its own frame'}"
    if not shared:
        against += (
            f", {reference} against {other or 'its own frame'}: another frame, so only figures without offsets count"
        )
    sentences = [
        f"{len(found.errors.times)} poses of {camera} against {against}, compared with {reference}, which moved by "
        f"{found.moved:.2f} m and turned by {found.turned:.0f} deg (standard deviations).",
        *_findings(found, is_same_frame=bool(shared)),
        *_limits(found, base, reference),
    ]
    if sight.lens is None:
        sentences.append(
            f"The recording has no lens in vision/{camera}/setup: all images count as with the target in view."
        )
    sheets = [_offsets(found), _errors(found, bool(shared)), *_classes(found), _rates(track, base, camera, reference)]
    reports = theirs.images(other)
    missing = drop_outs(base, reports, np.zeros(len(reports.times), dtype=bool))
    sheets += [_drop_outs(name, pauses) for name, pauses in ((camera, found.drop_outs), (reference, missing)) if pauses]
    return Chapter(camera, reference, True, sentences, sheets, list(_figures(found, place)))


def _findings(found: Baseline, *, is_same_frame: bool) -> Iterable[str]:
    """Offsets that are certain and matter, one sentence for each cause."""
    groups: dict[Group, list[str]] = {}
    for offset in found.offsets:
        if offset.is_found:
            value = f"{offset.quantity.name} {_shown(offset)} {offset.quantity.unit}"
            groups.setdefault(offset.quantity.group, []).append(value)
    for group, values in groups.items():
        yield f"Found: {', '.join(values)}: {group.cause}."
    if not groups and is_same_frame:
        yield "No constant offset, scale error or lag that matters was found."


def _limits(found: Baseline, base: PoseTrack, reference: str) -> Iterable[str]:
    """What the recording does not tell, and what to do."""
    open_groups = {offset.quantity.group: None for offset in found.offsets if not offset.is_known}
    if found.is_still:
        yield f"{reference} stood still, so offsets, scale and lag cannot be separated: carry or fly the aircraft."
    for group in open_groups:
        yield f"Not determined by this recording: {group.name}; {group.need}."
    if pauses := [end - begin for begin, end in base.pauses()]:
        yield f"{reference} dropped out {len(pauses)} times, for {sum(pauses):.1f} s; nothing is compared there."


def _shown(offset: Offset) -> str:
    factor = offset.quantity.factor
    return f"{factor * offset.value:+.2f} ± {factor * offset.sd:.2f}"


def _offsets(found: Baseline) -> TextTable:
    rows = [
        (f"{one.quantity.name} ({one.quantity.unit})", _shown(one), "yes" if one.is_known else "no")
        for one in found.offsets
    ]
    return TextTable("Constant offsets between both", ("quantity", "estimate ± sd", "determined"), rows)


def _errors(found: Baseline, is_same_frame: bool) -> TextTable:
    """Errors with the constant offsets and without them."""
    names = ("along the line of sight (cm)", "across it (cm)", "roll (deg)", "pitch (deg)", "yaw (deg)")
    raw, left = ((_CM * one.along, _CM * one.across, *one.rpy.T) for one in (found.raw, found.errors))
    rows = [
        (name, _spread(Spread.of(with_offsets) if is_same_frame else None, 1.0), _spread(Spread.of(without), 1.0))
        for name, with_offsets, without in zip(names, raw, left, strict=True)
    ]
    return TextTable("Errors: median / p90 / worst", ("error", "as recorded", "without offsets and lag"), rows)


def _spread(spread: Spread | None, factor: float) -> str:
    return "-" if spread is None else " / ".join(f"{factor * size:.2f}" for size in spread)


def _classes(found: Baseline) -> Iterable[TextTable]:
    head = ("images", "with a pose", "pairs", "scale", *_SPREADS)
    for title, unit, bins in (("distance", "m", found.distances), ("viewing angle", "deg", found.angles)):
        rows = []
        for one in bins:
            name = f"{one.low:g} to {one.high:g}" if math.isfinite(one.high) else f"above {one.low:g}"
            scale = "-" if one.scale is None else f"{one.scale:.4f}"
            spreads = (_spread(part, factor) for part, factor in zip(one[6:], (_CM, _CM, 1.0), strict=True))
            rows.append((name, f"{one.images:.0f}", _share(one), str(one.pairs), scale, *spreads))
        yield TextTable(f"By {title}, without offsets: median / p90 / worst", (f"{title} ({unit})", *head), rows)


def _share(one: Bin) -> str:
    return "-" if one.images < 1.0 else f"{100.0 * min(one.posed / one.images, 1.0):.1f} %"


def _rates(camera: PoseTrack, reference: PoseTrack, *names: str) -> TextTable:
    columns = []
    for track in (camera, reference):
        pauses = [end - begin for begin, end in track.pauses()]
        p50, p99 = _MS * np.quantile(track.latencies, (0.5, 0.99))
        mean = (len(track.times) - 1) / (track.times[-1] - track.times[0])
        columns.append([str(len(track.times)), f"{1.0 / track.period:.1f}", f"{mean:.1f}", f"{p50:.0f} / {p99:.0f}"])
        columns[-1] += [str(len(pauses)), f"{sum(pauses):.2f}", f"{max(pauses, default=0.0):.2f}"]
    words = ["poses", "usual rate (Hz)", "mean rate (Hz)", "latency, p50 / p99 (ms)"]
    words += ["drop-outs", "together (s)", "longest (s)"]
    return TextTable("Rates and drop-outs", ("", *names), list(zip(words, *columns, strict=True)))


def _drop_outs(name: str, found: Sequence[DropOut]) -> TextTable:
    """Drop-outs by reason and length."""
    edges = [*pairwise(LENGTHS)]
    classes = [f"{low:g} to {high:g} s" if math.isfinite(high) else f"above {low:g} s" for low, high in edges]
    rows = []
    for reason in sorted({one.reason for one in found}):
        lengths = [one.length for one in found if one.reason == reason]
        counts = [str(sum(low <= one < high for one in lengths)) for low, high in edges]
        rows.append((reason, *counts, f"{sum(lengths):.2f}", f"{max(lengths):.2f}"))
    return TextTable(f"Drop-outs of {name} by reason", ("reason", *classes, "together (s)", "longest (s)"), rows)


# -- figures ----------------------------------------------------------------------------------------------------------


def _figures(found: Baseline, place: int) -> Iterable[Plot]:
    errors = found.errors
    medians = [
        (one.low, min(one.high, 1.5 * one.low + 1.0), one.scale) for one in found.distances if one.scale is not None
    ]
    steps = {
        "type": "scatter",
        "mode": "lines",
        "name": "median of the class",
        "line": {"color": RED, "width": 2},
        "x": [edge for low, high, _ in medians for edge in (low, high, None)],
        "y": [value for *_, scale in medians for value in (scale, scale, None)],
    }
    dots = _dots(errors, errors.distances, errors.scales, "one pose", BLUE)
    yield _figure(f"scale{place}", "Position scale by distance", "distance [m]", "measured / true", [dots, steps])
    parts = [
        _dots(errors, errors.distances, _CM * errors.along, "along the line of sight", BLUE),
        _dots(errors, errors.distances, _CM * errors.across, "across it", ORANGE),
    ]
    yield _figure(f"place{place}-error", "Position error by distance", "distance [m]", "cm", parts)
    axes = zip(("roll", "pitch", "yaw"), (BLUE, ORANGE, GREEN), errors.rpy.T, strict=True)
    turns = [_dots(errors, errors.angles, values, name, colour) for name, colour, values in axes]
    yield _figure(f"turn{place}", "Angle deviation by viewing angle", "viewing angle [deg]", "deg", turns)
    for name, title, unit, bins in (
        ("near", "Detection by distance", "distance [m]", found.distances),
        ("steep", "Detection by viewing angle", "viewing angle [deg]", found.angles),
    ):
        seen = [one for one in bins if one.images >= 1.0]
        bars = {
            "type": "bar",
            "name": "with a pose; number: images",
            "textangle": 0,
            "marker": {"color": GREEN},
            "x": [f"{one.low:g}-{one.high:g}" if math.isfinite(one.high) else f"> {one.low:g}" for one in seen],
            "y": [round(100.0 * min(one.posed / one.images, 1.0), 2) for one in seen],
            "text": [f"{one.images:.0f}" for one in seen],
        }
        yield _figure(f"{name}{place}", title, unit, "%", [bars], xaxis={"type": "category"}, yaxis={"range": [0, 100]})
    over_time = [
        _dots(errors, errors.times, _CM * errors.along, "along the line of sight [cm]", BLUE),
        _dots(errors, errors.times, errors.turns, "rotation [deg]", GREEN),
    ]
    yield _figure(f"when{place}", "Errors over time", "time [s]", "cm, deg", over_time)


def _dots(errors: PairErrors, x: Array, y: Array, name: str, colour: str) -> dict[str, Any]:
    """A dot a pair, of up to `DOTS`."""
    step = math.ceil(len(errors.times) / DOTS)
    return {
        "type": "scatter",
        "mode": "markers",
        "name": escape(name),
        "marker": {"color": colour, "size": 4, "opacity": 0.5},
        "x": np.round(x[::step], 3).tolist(),
        "y": np.round(y[::step], 4).tolist(),
    }


def _figure(
    name: str,
    title: str,
    across: str,
    up: str,
    data: list[dict[str, Any]],
    xaxis: dict[str, Any] | None = None,
    yaxis: dict[str, Any] | None = None,
) -> Plot:
    layout = {
        "height": 300,
        "hovermode": "closest",
        "xaxis": {"title": {"text": across}} | (xaxis or {}),
        "yaxis": {"title": {"text": up}, "zeroline": True} | (yaxis or {}),
    }
    return Plot(f"against-{name}", title, data, layout, is_alone=True)
