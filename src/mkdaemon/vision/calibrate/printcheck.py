"""Is a print to scale, flat, sharp, and does it have its white rim? By one photograph. Pure.

What one photograph can tell: sizes and places of the tags of one plane against each other; with a camera file whether
the print is as wide as it is high, and whether its edges are straight; with a distance measured by tape how large it
is. What it cannot: sizes that are all wrong by one factor, without that distance; a bend about an axis that the camera
looks along; whether the print or the photograph is blurred.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.limits import HALF, LIMITS
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.still import StillEye
from mkdaemon.vision.tags.cellread import carry, image_from_cells, sample
from mkdaemon.vision.tags.detection import Detection, best_of_codes, mean_side
from mkdaemon.vision.tags.tagmap import Tag, TagMap, Target

ALONG: Final = 25
"""Places along a side where its edge is measured."""
SKIPPED: Final = 0.06
"""Part of a side beside each corner that is left out [1]: two edges meet there."""
EDGE_SHARE: Final = 0.4
"""Of the usual step from black to white of a side, below which a place of it shows no edge."""
EDGE_GREY: Final = 10.0
"""Nor does a smaller step [grey]."""
STEP_PX: Final = 0.25
"""Between the grey values across a side, at most [px]."""
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


_Finding = tuple[PrintState, str, str]
"""A finding without its name."""


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """A tag with its sides measured.

    Attributes:
        tag: of the target file.
        seen: as it was found.
        corners: where its sides meet `(4, 2)`, undistorted where the lens is known [px, or at unit depth].
        unsure: deviation of a corner, as a share of the side [1].
        bow: how far the middle of its most bent side leaves its chord, and the deviation of that [% of its length].
        blur: deviation of its edges from sharp [px].
        cell: side of a cell [px].
    """

    tag: Tag
    seen: Detection
    corners: Array
    unsure: float
    bow: tuple[float, float]
    blur: float
    cell: float

    @property
    def softness(self) -> float:
        """How soft its edges are [cells]."""
        return self.blur / self.cell


def check_print(
    pixels: Grey, target: Target, intrinsics: Intrinsics | None = None, distance: float | None = None
) -> tuple[PrintFinding, ...]:
    """Judge a print by one photograph.

    Args:
        pixels: `(h, w)` uint8.
        target: what was printed, as its file says; one plane.
        intrinsics: of the camera, for exactly this size of image; None where it is not calibrated.
        distance: from the lens to the middle of the largest tag in view, by tape [m].

    Returns:
        What was found, most important first; only that nothing was found where no tag was decoded.
    """
    projection = None if intrinsics is None else Projection(intrinsics)
    tagmap = TagMap((target,))
    tags = best_of_codes(tag.found for tag in StillEye(None, tagmap=tagmap).look(pixels).tags)
    found = [_measure(pixels, tagmap.owners[seen.code][1], seen, projection) for seen in tags]
    measured = [one for one in found if one is not None]
    if not measured:
        words = "no tag of the target was found in the photograph"
        fix = "Show the whole print, sharp, filling half of the photograph; check --target."
        return (PrintFinding("tags", PrintState.BAD, words, fix),)
    light, rim = _light_and_rim(pixels, measured)
    found_by = {
        "tags": _seen(target, measured),
        "sizes among tags": _relative(target, measured),
        "width over height": _aspect(measured[0], is_calibrated=intrinsics is not None),
        "size": _absolute(measured[0], None if intrinsics is None else distance),
        "flat": _flatness(measured, is_calibrated=intrinsics is not None),
        "sharp": _sharpness(measured),
        "light": light,
        "white rim": rim,
    }
    good = PrintState.GOOD
    return tuple(
        PrintFinding(name, state, words, "" if state is good else fix) for name, (state, words, fix) in found_by.items()
    )


def softness(pixels: Grey, corners: Array, cells: int) -> float | None:
    """How soft the edges of a tag of `cells` a side are, as a share of a cell [1]; None where they do not show."""
    found = [spread for _, spread in _edges(pixels, corners, cells)]
    return float(np.median(found)) / (mean_side(corners) / cells) if found else None


def _judged(words: str, fix: str, *, is_bad: bool) -> _Finding:
    """What is either good or bad."""
    return PrintState.BAD if is_bad else PrintState.GOOD, words, fix


def _weighed(
    figures: Iterable[tuple[float, float]], bound: float, words: str, fix: str, certain: float = CERTAIN
) -> _Finding:
    """Judge errors and their deviations: one over its bound, and by no accident, is bad; a loose one tells nothing."""
    errors, deviations = np.abs(np.array(list(figures))).T
    if (errors > np.maximum(bound, certain * deviations)).any():
        return PrintState.BAD, words, fix
    if (deviations > LOOSE * bound).any():
        return PrintState.UNKNOWN, words, "Take a sharp photograph, nearer and more from the front."
    return PrintState.GOOD, words, fix


def _measure(pixels: Grey, tag: Tag, seen: Detection, projection: Projection | None) -> _Measured | None:
    """Measure the four sides of a tag; None where an edge is not there."""
    edges = _edges(pixels, seen.corners, tag.family.size_cells)
    if len(edges) < len(seen.corners):
        return None
    lines = [_line(points if projection is None else projection.undistort(points)) for points, _ in edges]
    pairs = zip([lines[-1], *lines], lines, strict=False)
    corners = np.array(
        [a + u * np.linalg.solve(np.column_stack([u, -v]), b - a)[0] for (a, u, *_), (b, v, *_) in pairs]
    )
    bow, noise = max(abs(line[2]) for line in lines), float(np.mean([line[3] for line in lines]))
    side, cell = seen.side_px, seen.side_px / tag.family.size_cells
    blur = float(np.median([spread for _, spread in edges]))
    # A side is known better than its points. Where cells melt its edges are not where they seem.
    least = blur if blur > BLUR_CELLS * cell else LEAST_CORNER
    unsure = max(3.0 * noise / math.sqrt(ALONG), least / side)
    return _Measured(tag, seen, corners, unsure, (100 * bow, 100 * max(unsure, LEAST_BOW / side)), blur, cell)


def _edges(pixels: Grey, corners: Array, cells: int) -> list[tuple[Array, float]]:
    """Places of the edges along the sides of a tag `(n, 2)` [px], and how soft they are [px]; of those that show."""
    chords = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-chords[:, 1], chords[:, 0]]) / np.linalg.norm(chords, axis=1)[:, None]
    # two corners lie on a side; the nearer one of the others says how far the quad reaches behind it
    depths = np.sort(np.abs(corners @ normals.T - (normals * corners).sum(axis=1)), axis=0)[2]
    reach = np.maximum(0.6 * depths / cells, 1.5)
    base = corners[:, None] + np.linspace(SKIPPED, 1.0 - SKIPPED, ALONG)[:, None] * chords[:, None]
    half = math.ceil(float(reach.max()) / STEP_PX)
    steps = (reach[:, None] * np.linspace(-1.0, 1.0, 2 * half + 1))[:, None]
    places = base[:, :, None] + steps[..., None] * normals[:, None, None]
    profile = sample(pixels, places.reshape(-1, 2)).reshape(places.shape[:3])
    rise = profile[..., -3:].mean(axis=2) - profile[..., :3].mean(axis=2)
    usual = np.median(rise, axis=1, keepdims=True)
    weight = np.maximum(np.gradient(profile, axis=2) * np.sign(usual)[..., None], 0.0) ** 2
    weight /= np.maximum(weight.sum(axis=2, keepdims=True), 1e-9)
    middle = (weight * steps).sum(axis=2, keepdims=True)
    # The square of a bell's slope is narrower than the bell by the root of two.
    spread = np.sqrt(2.0 * (weight * (steps - middle) ** 2).sum(axis=2))
    good = rise * np.sign(usual) > np.maximum(EDGE_SHARE * np.abs(usual), EDGE_GREY)
    sides = zip(base + middle * normals[:, None], spread, good, strict=True)
    return [(found[on], float(np.median(wide[on]))) for found, wide, on in sides if on.sum() >= ALONG // 2]


def _line(points: Array) -> tuple[Array, Array, float, float]:
    """A point and the way of the line through a side, how far its middle leaves its chord, and the scatter about that.

    Both as shares of its length.
    """
    middle = points.mean(axis=0)
    way = np.asarray(np.linalg.svd(points - middle)[2][0], np.float64)
    place, off = np.array([way, [-way[1], way[0]]]) @ (points - middle).T
    place, off = 2.0 * place / np.ptp(place), off / np.ptp(place)
    parabola = np.polyfit(place, off, 2)
    return middle, way, float(parabola[0]), float(np.std(off - np.polyval(parabola, place)))


def _lengths(corners: Array) -> list[float]:
    """How long two sides of a square are, and how far its middle is away, by corners at unit depth; up to a factor."""
    square = image_from_cells(corners, 1) @ np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    lengths: list[float] = np.linalg.norm(square, axis=0).tolist()
    return lengths


def _seen(target: Target, measured: Sequence[_Measured]) -> _Finding:
    names = ", ".join(f"{one.tag.tag_id} ({one.cell:.1f} px a cell)" for one in measured)
    words = f"{len(measured)} of {len(target.tags)} measured: {names}"
    is_far = measured[0].cell < LIMITS.cells.mixed_px
    if len(measured) < len(target.tags) and not is_far:
        return PrintState.UNKNOWN, words, "Take another photograph that shows the others."
    return _judged(words, "Take the photograph nearer: every figure below is loose.", is_bad=is_far)


def _relative(target: Target, measured: Sequence[_Measured]) -> _Finding:
    """Sizes and places of the other tags, by the largest one."""
    base, *others = measured
    if not others or not target.is_planar:
        words = "one tag in view: nothing to compare it with" if target.is_planar else "its tags are not in one plane"
        return PrintState.UNKNOWN, words, "Measure the tag with a ruler."
    back = np.asarray(np.linalg.inv(image_from_cells(base.corners, 1)), np.float64)
    figures, lines = [], []
    for one in others:
        # in sides of the base from its top left corner, y down
        seen = carry(back, one.corners)
        place = (one.tag.position - base.tag.corners[0]) @ base.tag.rotation[:, :2] * (1.0, -1.0) / base.tag.size
        off = float(np.linalg.norm(seen.mean(axis=0) - place))
        loose = 100 * math.hypot(one.unsure, base.unsure)
        size = 100 * (mean_side(seen) * base.tag.size / one.tag.size - 1.0), loose
        figures += [size, (100 * off, loose)]
        lines.append(
            f"{one.tag.tag_id} is {_percent(size)} of its size, {1000 * off * base.tag.size:.1f} mm off its place"
        )
    fix = "Write the sizes and places that a ruler shows into the target file, or print it anew."
    return _weighed(figures, SCALE_PERCENT, f"against tag {base.tag.tag_id}: {'; '.join(lines)}", fix)


def _percent(figure: tuple[float, float]) -> str:
    return f"{figure[0]:+.2f} +- {figure[1]:.2f} %"


def _aspect(base: _Measured, *, is_calibrated: bool) -> _Finding:
    """Whether a square tag is as wide as it is high."""
    if not is_calibrated:
        words = "without a camera file a tilt looks like a print that is too narrow"
        return PrintState.UNKNOWN, words, "Give --camera, or measure both sides with a ruler."
    moves = base.unsure * mean_side(base.corners) * np.eye(base.corners.size).reshape(-1, *base.corners.shape)
    lengths = (_lengths(base.corners + move) for move in (0.0, *moves))
    here, *moved = (wide / high for wide, high, _ in lengths)
    figure = 100 * (here - 1.0), 100 * float(np.linalg.norm(np.array(moved) - here))
    fix = "Print it anew at 100 %, without fitting to the page."
    return _weighed([figure], SCALE_PERCENT, f"{_percent(figure)} by tag {base.tag.tag_id}", fix)


def _absolute(base: _Measured, distance: float | None) -> _Finding:
    """How large the print is, by a distance that somebody measured to a camera with a file."""
    ruler = f"Measure tag {base.tag.tag_id} with a ruler: {1000 * base.tag.size:.1f} mm by its file."
    if distance is None:
        words = "one photograph cannot tell sizes that are all wrong by one factor"
        return PrintState.UNKNOWN, words, f"{ruler} Or give --camera and --distance by tape."
    wide, high, away = _lengths(base.corners)
    depth = base.tag.size * 2.0 * away / (wide + high)
    figure = 100 * (distance / depth - 1.0), 100 * math.hypot(TAPE, base.unsure)
    words = f"{_percent(figure)}: the image says {depth:.3f} m, the tape {distance:.3f} m"
    return _weighed([figure], SCALE_PERCENT, words, ruler, CERTAIN_BY_TAPE)


def _flatness(measured: Sequence[_Measured], *, is_calibrated: bool) -> _Finding:
    """Whether sides are straight."""
    one = max(
        measured,
        key=lambda one: (one.bow[1] <= LOOSE * BOW_PERCENT, one.bow[0] / max(BOW_PERCENT, CERTAIN * one.bow[1])),
    )
    words = f"the most bent side of tag {one.tag.tag_id} leaves its chord by {_percent(one.bow)} of its length"
    fix = "Glue the print to something flat."
    if is_calibrated:
        words += "; a bend that the camera looks along is seen from another side"
        return _weighed([one.bow], BOW_PERCENT, words, fix)
    state, words, fix = _weighed([one.bow], BOW_PERCENT, f"{words}; lenses bend lines, too", f"Give --camera. {fix}")
    return PrintState.UNKNOWN if state is PrintState.BAD else state, words, fix


def _sharpness(measured: Sequence[_Measured]) -> _Finding:
    one = max(measured, key=lambda one: one.softness)
    words = f"edges of tag {one.tag.tag_id} are {one.blur:.2f} px soft, {one.softness:.2f} of its cells"
    fix = "Focus, hold still, take it nearer; if a sharp photograph says the same, print with a better printer."
    return _judged(words, fix, is_bad=one.softness > BLUR_CELLS)


def _light_and_rim(pixels: Grey, measured: Sequence[_Measured]) -> tuple[_Finding, _Finding]:
    rims = [(levels, one.tag.tag_id) for one in measured if (levels := _rim(pixels, one)) is not None]
    if not rims:
        unknown = PrintState.UNKNOWN, "the rim is not in the photograph", "Show more of the paper around the tags."
        return unknown, unknown
    black, white, _ = np.median([levels for levels, _ in rims], axis=0)
    is_dark = bool(white - black < CONTRAST)
    fix = "More light, or a darker print." if is_dark else "Expose less: blown white moves every edge."
    light = _judged(
        f"black is {black:.0f}, white {white:.0f} of 255", fix, is_bad=is_dark or bool(white > LIMITS.read.saturated)
    )
    share, tag_id = min((levels[2], tag_id) for levels, tag_id in rims)
    words = f"{100 * share:.0f} % of one cell around tag {tag_id} is white"
    fix = "Leave one cell of white around everything black; remove what lies on it."
    return light, _judged(words, fix, is_bad=share < WHITE_SHARE)


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
