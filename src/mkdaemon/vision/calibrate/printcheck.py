"""Whether a print is to scale, flat, sharp, and has its white rim, by one photograph: docs/cameras.md, "Check it"."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import cv2
import numpy as np

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.edgefind import HALF_WIDTH, find_edges
from mkdaemon.vision.pose.edgemodel import EdgeModel, Samples, seen_across
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.still import StillEye
from mkdaemon.vision.tags.cellread import Detection, best_of_codes, carry, image_from_cells, mean_side, sample
from mkdaemon.vision.tags.tagmap import Tag, TagMap, Target, single

LEAST_EDGES: Final = 12
"""That are found along a side, where it is one."""
CERTAIN, LOOSE = 3.0, 2.0
"""Deviations from which an error is no accident, and deviation over the bound from which a figure tells nothing."""
SCALE_PERCENT: Final = 1.0
"""A size that is off by more is wrong [%]; a printer that fits to the page is off by 3 to 6."""
BOW_PERCENT: Final = 0.4
"""A side that leaves its chord by more of its length is bent [%]: 1 mm of 250."""
LEAST_BOW: Final = 0.1
"""A side is not known to be straighter than this [px]: pixels are squares, and cells beside it are not alike."""
LEAST_CORNER: Final = 0.05
"""Nor is a corner known better [px]."""
BLUR_CELLS: Final = 0.25
"""Deviation of an edge from sharp above which cells begin to melt [cells]."""
CONTRAST: Final = 50.0
"""Least difference between white and black [grey]."""
WHITE_SHARE: Final = 0.97
"""Part of the rim that has to be white [1]."""
CERTAIN_BY_TAPE: Final = 2.0
"""Deviations from which a size by tape is no accident: it may be measured once more."""
TAPE: Final = 0.005
"""Deviation of a distance measured by tape, as a share [1]; with that of a calibrated focal length."""


class PrintState(StrEnum):
    """What a check found."""

    GOOD = "good"
    BAD = "bad"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class PrintFinding:
    """One check: what was looked at, what was found, the figures in a sentence, and what to do, if anything."""

    name: str
    state: PrintState
    words: str
    fix: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """A tag with its sides measured.

    Attributes:
        corners: where its sides meet `(4, 2)`, undistorted where the lens is known [px, or at unit depth].
        unsure: deviation of a corner, as a share of the side [1].
        bow: how far the middle of its most bent side leaves its chord, and the deviation of that [% of its length].
        cell: side of a cell [px].
        softness: how soft its edges are [cells].
    """

    tag: Tag
    seen: Detection
    corners: Array
    unsure: float
    bow: tuple[float, float]
    cell: float
    softness: float


def check_print(
    pixels: Grey, target: Target, intrinsics: Intrinsics | None = None, distance: float | None = None
) -> tuple[PrintFinding, ...]:
    """Judge a print by one photograph, the most important first.

    Args:
        pixels: `(h, w)` uint8.
        target: what was printed, as its file says; one plane.
        intrinsics: of the camera, for exactly this size of image; None where it is not calibrated.
        distance: from the lens to the middle of the largest tag in view, by tape [m].
    """
    projection = None if intrinsics is None else Projection(intrinsics)
    tagmap = TagMap((target,))
    tags = best_of_codes(tag.found for tag in StillEye(tagmap=tagmap).look(pixels).tags)
    found = [_measure(pixels, tagmap.owners[seen.code][1], seen, projection) for seen in tags]
    measured = [one for one in found if one is not None]
    if not measured:
        words = "no tag of the target was found in the photograph"
        fix = "Show the whole print, sharp, filling half of the photograph; check --target."
        return (PrintFinding("tags", PrintState.BAD, words, fix),)
    return (
        _seen(target, measured),
        _relative(target, measured),
        _aspect(measured[0], is_calibrated=intrinsics is not None),
        _absolute(measured[0], None if intrinsics is None else distance),
        _flatness(measured, is_calibrated=intrinsics is not None),
        _sharpness(measured),
        *_light_and_rim(pixels, measured),
    )


def softness(pixels: Grey, found: Detection) -> float | None:
    """Width of a tag's edges as a share of a cell [1]; None if none is visible, or cells are too small."""
    tag = single(1.0, found.tag_id, family=found.family).tags[0]
    sides, blur = _sides(pixels, tag, found.corners)
    cell = found.side_px / tag.family.size_cells
    return blur / cell if any(map(len, sides)) and cell >= LIMITS.cells.photometric_px else None


def _judged(name: str, words: str, fix: str, *, is_bad: bool) -> PrintFinding:
    """What is either good or bad."""
    return PrintFinding(name, PrintState.BAD, words, fix) if is_bad else PrintFinding(name, PrintState.GOOD, words)


def _weighed(
    name: str, figures: Iterable[tuple[float, float]], bound: float, words: str, fix: str, certain: float = CERTAIN
) -> PrintFinding:
    """Judge errors and their deviations: one over its bound, and by no accident, is bad; a loose one tells nothing."""
    errors, deviations = np.abs(np.array(list(figures))).T
    is_bad = bool((errors > np.maximum(bound, certain * deviations)).any())
    if not is_bad and (deviations > LOOSE * bound).any():
        return PrintFinding(name, PrintState.UNKNOWN, words, "Take a sharp photograph, nearer and more from the front.")
    return _judged(name, words, fix, is_bad=is_bad)


def _measure(pixels: Grey, tag: Tag, seen: Detection, projection: Projection | None) -> _Measured | None:
    """Measure the four sides of a tag; None where an edge is not there."""
    sides, blur = _sides(pixels, tag, seen.corners)
    if min(map(len, sides)) < LEAST_EDGES:
        return None
    lines, bows, noises = zip(
        *(_line(points if projection is None else projection.undistort(points)) for points in sides), strict=True
    )
    crossings = np.cross(np.roll(lines, 1, axis=0), lines)
    side, cell = seen.side_px, seen.side_px / tag.family.size_cells
    # A side is known better than its points. Where cells melt its edges are not where they seem.
    least = blur if blur > BLUR_CELLS * cell else LEAST_CORNER
    unsure = max(3.0 * float(np.mean(noises)) / math.sqrt(np.mean(list(map(len, sides)))), least / side)
    bow = 100 * float(np.abs(bows).max()), 100 * max(unsure, LEAST_BOW / side)
    return _Measured(tag, seen, crossings[:, :2] / crossings[:, 2:], unsure, bow, cell, blur / cell)


def _sides(pixels: Grey, tag: Tag, corners: Array) -> tuple[list[Array], float]:
    """Places of the edges that are found along each side of a tag `(n, 2)` [px], and how soft they are [px]."""
    model, n = EdgeModel.of(Target("", "", moving=False, level=False, tags=(tag,))), tag.family.size_cells
    cells = tag.local(model.stepped)[:, :2] * (1.0, -1.0) / tag.module + n / 2
    stepped, count = carry(image_from_cells(corners, n), cells), len(model.points)
    normals, cell_px = seen_across(stepped)
    samples = Samples(np.arange(count), stepped[:count], normals, HALF * cell_px, cell_px, model.upright)
    edges = find_edges(pixels, samples)
    places, (x, y) = samples.pixels + edges.offsets[:, None] * normals, cells[:count].T
    sides = [places[edges.found & np.isclose(at, end)] for at, end in ((y, 0.0), (x, n), (y, n), (x, 0.0))]
    return sides, edges.width / HALF_WIDTH


def _line(points: Array) -> tuple[Array, float, float]:
    """The line through a side `(3,)`; as shares of its length, how far its middle leaves its chord, and the scatter."""
    middle = points.mean(axis=0)
    way = np.asarray(np.linalg.svd(points - middle)[2][0], np.float64)
    normal = np.array([-way[1], way[0]])
    place, off = (points - middle) @ way, (points - middle) @ normal
    place, off = 2.0 * place / np.ptp(place), off / np.ptp(place)
    parabola = np.polyfit(place, off, 2)
    scatter = float(np.std(off - np.polyval(parabola, place)))
    return np.append(normal, -normal @ middle), float(parabola[0]), scatter


def _lengths(corners: Array) -> list[float]:
    """How long two sides of a square are, and how far its middle is away, by corners at unit depth; up to a factor."""
    square = image_from_cells(corners, 1) @ np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    lengths: list[float] = np.linalg.norm(square, axis=0).tolist()
    return lengths


def _seen(target: Target, measured: Sequence[_Measured]) -> PrintFinding:
    names = ", ".join(f"{one.tag.tag_id} ({one.cell:.1f} px a cell)" for one in measured)
    words = f"{len(measured)} of {len(target.tags)} measured: {names}"
    is_far = measured[0].cell < LIMITS.cells.mixed_px
    if len(measured) < len(target.tags) and not is_far:
        return PrintFinding("tags", PrintState.UNKNOWN, words, "Take another photograph that shows the others.")
    return _judged("tags", words, "Take the photograph nearer: every figure below is loose.", is_bad=is_far)


def _relative(target: Target, measured: Sequence[_Measured]) -> PrintFinding:
    """Sizes and places of the other tags, by the largest one."""
    base, *others = measured
    if not others or not target.is_planar:
        words = "one tag in view: nothing to compare it with" if target.is_planar else "its tags are not in one plane"
        return PrintFinding("sizes among tags", PrintState.UNKNOWN, words, "Measure the tag with a ruler.")
    # from the image to the plane of the tags [m]
    square = base.tag.local(base.tag.corners)[:, :2].astype(np.float32)
    back = np.asarray(cv2.getPerspectiveTransform(base.corners.astype(np.float32), square), np.float64)
    figures, lines = [], []
    for one in others:
        seen, loose = carry(back, one.corners), 100 * math.hypot(one.unsure, base.unsure)
        off = float(np.linalg.norm(seen.mean(axis=0) - base.tag.local(one.tag.position)[:2]))
        size = 100 * (mean_side(seen) / one.tag.size - 1.0), loose
        figures += [size, (100 * off / base.tag.size, loose)]
        lines.append(f"{one.tag.tag_id} is {_percent(size)} of its size, {1000 * off:.1f} mm off its place")
    fix = "Write the sizes and places that a ruler shows into the target file, or print it again."
    words = f"against tag {base.tag.tag_id}: {'; '.join(lines)}"
    return _weighed("sizes among tags", figures, SCALE_PERCENT, words, fix)


def _percent(figure: tuple[float, float]) -> str:
    return f"{figure[0]:+.2f} +- {figure[1]:.2f} %"


def _aspect(base: _Measured, *, is_calibrated: bool) -> PrintFinding:
    """Whether a square tag is as wide as it is high."""
    if not is_calibrated:
        words = "without a camera file a tilt looks like a print that is too narrow"
        return PrintFinding(
            "width over height", PrintState.UNKNOWN, words, "Give --camera, or measure both sides with a ruler."
        )
    moves = base.unsure * mean_side(base.corners) * np.eye(base.corners.size).reshape(-1, *base.corners.shape)
    lengths = (_lengths(base.corners + move) for move in (0.0, *moves))
    here, *moved = (wide / high for wide, high, _ in lengths)
    figure = 100 * (here - 1.0), 100 * float(np.linalg.norm(np.array(moved) - here))
    fix = "Print it again at 100 %, without fitting to the page."
    words = f"{_percent(figure)} by tag {base.tag.tag_id}"
    return _weighed("width over height", [figure], SCALE_PERCENT, words, fix)


def _absolute(base: _Measured, distance: float | None) -> PrintFinding:
    """Size of the print, from a measured distance to a calibrated camera."""
    ruler = f"Measure tag {base.tag.tag_id} with a ruler: {1000 * base.tag.size:.1f} mm by its file."
    if distance is None:
        words = "one photograph cannot tell sizes that are all wrong by one factor"
        return PrintFinding("size", PrintState.UNKNOWN, words, f"{ruler} Or give --camera and --distance by tape.")
    wide, high, away = _lengths(base.corners)
    depth = base.tag.size * 2.0 * away / (wide + high)
    figure = 100 * (distance / depth - 1.0), 100 * math.hypot(TAPE, base.unsure)
    words = f"{_percent(figure)}: the image says {depth:.3f} m, the tape {distance:.3f} m"
    return _weighed("size", [figure], SCALE_PERCENT, words, ruler, CERTAIN_BY_TAPE)


def _flatness(measured: Sequence[_Measured], *, is_calibrated: bool) -> PrintFinding:
    """Whether sides are straight."""
    one = max(
        measured,
        key=lambda one: (one.bow[1] <= LOOSE * BOW_PERCENT, one.bow[0] / max(BOW_PERCENT, CERTAIN * one.bow[1])),
    )
    why = "a bend that the camera looks along is seen from another side" if is_calibrated else "lenses bend lines, too"
    words = f"the most bent side of tag {one.tag.tag_id} leaves its chord by {_percent(one.bow)} of its length; {why}"
    fix = "Glue the print to something flat."
    found = _weighed("flat", [one.bow], BOW_PERCENT, words, fix)
    may_be_lens = found.state is PrintState.BAD and not is_calibrated
    return replace(found, state=PrintState.UNKNOWN, fix=f"Give --camera. {fix}") if may_be_lens else found


def _sharpness(measured: Sequence[_Measured]) -> PrintFinding:
    one = max(measured, key=lambda one: one.softness)
    words = f"edges of tag {one.tag.tag_id} are soft over {one.softness:.2f} of its cells"
    fix = "Focus, hold still, take it nearer; if a sharp photograph says the same, print with a better printer."
    return _judged("sharp", words, fix, is_bad=one.softness > BLUR_CELLS)


def _light_and_rim(pixels: Grey, measured: Sequence[_Measured]) -> tuple[PrintFinding, PrintFinding]:
    rims = [(levels, one.tag.tag_id) for one in measured if (levels := _rim(pixels, one)) is not None]
    if not rims:
        unknown = PrintState.UNKNOWN, "the rim is not in the photograph", "Show more of the paper around the tags."
        return PrintFinding("light", *unknown), PrintFinding("white rim", *unknown)
    black, white, _ = np.median([levels for levels, _ in rims], axis=0)
    is_dark = bool(white - black < CONTRAST)
    fix = "More light, or a darker print." if is_dark else "Expose less: blown white moves every edge."
    words = f"black is {black:.0f}, white {white:.0f} of 255"
    light = _judged("light", words, fix, is_bad=is_dark or bool(white > LIMITS.read.saturated))
    share, tag_id = min((levels[2], tag_id) for levels, tag_id in rims)
    words = f"{100 * share:.0f} % of one cell around tag {tag_id} is white"
    fix = "Leave one cell of white around everything black; remove what lies on it."
    return light, _judged("white rim", words, fix, is_bad=share < WHITE_SHARE)


def _rim(pixels: Grey, one: _Measured) -> tuple[float, float, float] | None:
    """Black, white, and how many of the cells around are white; None where they leave the image."""
    family = one.tag.family
    reach = (family.black_cells + 1) / 2
    around = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    places = carry(image_from_cells(one.seen.corners, family.size_cells), around + family.size_cells / 2)
    if (places < 0.0).any() or (places > np.subtract(pixels.shape[::-1], 1)).any():
        return None
    values, is_rim = sample(pixels, places), np.abs(around).max(axis=1) == reach
    white, black = float(np.percentile(values[is_rim], 75)), float(np.percentile(values[~is_rim], 25))
    return black, white, float((values[is_rim] > HALF * (white + black)).mean())
