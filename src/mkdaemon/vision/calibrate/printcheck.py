"""Is a print to scale, flat, sharp, and does it have its white rim? By one photograph. Pure.

What one photograph can tell: sizes and places of the tags of one plane against each other; with a camera file whether
the print is as wide as it is high, and whether its edges are straight; with a distance measured by tape how large it
is. What it cannot: sizes that are all wrong by one factor, without that distance; a bend about an axis that the camera
looks along; whether the print or the photograph is blurred.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.still import StillEye
from mkdaemon.vision.tags.cellread import carry, cell_values, image_from_cells
from mkdaemon.vision.tags.detection import Detection, best_of_codes, mean_side
from mkdaemon.vision.tags.tagmap import Tag, TagMap, Target

ALONG: Final = 25
"""Places along a side where its edge is measured."""
SKIPPED: Final = 0.06
"""Part of a side beside each corner that is left out [1]: two edges meet there."""
EDGE_SHARE: Final = 0.4
"""Of the usual step from black to white, below which a place of a side shows no edge."""
EDGE_GREY: Final = 10.0
"""Nor does a smaller step [grey]."""
SCALE_PERCENT: Final = 1.0
"""A size that is off by more is wrong [%]; a printer that fits to the page is off by 3 to 6."""
BOW_PERCENT: Final = 0.4
"""A side that leaves its chord by more of its length is bent [%]: 1 mm of 250."""
LEAST_BOW: Final = 0.1
"""A side is not known to be straighter than this [px]: pixels are squares, and cells beside it are not alike."""
BLUR_CELLS: Final = 0.25
"""Deviation of an edge from sharp above which cells begin to melt [cells]."""
LEAST_CELL: Final = 5.0
"""Cells of fewer pixels are too few to judge a print by [px]."""
CONTRAST: Final = 50.0
"""Least difference between white and black [grey]."""
BLOWN: Final = 253.5
"""White that is brighter has lost its edges [grey]."""
WHITE_SHARE: Final = 0.97
"""Part of the rim that has to be white [1]."""
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
        tag: of the target file.
        corners: where its sides meet `(4, 2)`, undistorted where the lens is known [px, or at unit depth].
        raw: the same as they are in the image `(4, 2)` [px].
        bows: how far the middle of each side leaves its chord, as a share of its length `(4,)` [1].
        noise: scatter of the edges about the sides [px].
        blur: deviation of the edges from sharp [px].
        side: mean length of a side [px].
    """

    tag: Tag
    corners: Array
    raw: Array
    bows: Array
    noise: float
    blur: float
    side: float

    @property
    def cell(self) -> float:
        """Side of a cell [px]."""
        return self.side / self.tag.family.size_cells

    @property
    def is_sharp(self) -> bool:
        """Whether its cells stand apart, so that its edges are where they seem."""
        return self.blur <= BLUR_CELLS * self.cell

    @property
    def corner_sd(self) -> float:
        """Deviation of a corner [px]: a side is known better than its points, never better than a fiftieth."""
        return max(3.0 * self.noise / math.sqrt(ALONG), 0.05)

    @property
    def bow(self) -> tuple[float, float]:
        """How far its most bent side leaves its chord, and the deviation of that [% of its length]."""
        return 100 * float(np.abs(self.bows).max()), 100 * max(self.corner_sd, LEAST_BOW) / self.side

    @property
    def bend(self) -> float:
        """The same as a share of what may be [1]."""
        percent, loose = self.bow
        return percent / max(BOW_PERCENT, 3 * loose)


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
    tags = best_of_codes((tag.found for tag in StillEye(None, tagmap=tagmap).look(pixels).tags), lambda one: ())
    found = [_measure(pixels, tagmap.owners[seen.code][1], seen, projection) for seen in tags]
    measured = [one for one in found if one is not None]
    if not measured:
        words = "no tag of the target was found in the photograph"
        fix = "Show the whole print, sharp, filling half of the photograph; check --target."
        return (PrintFinding("tags", PrintState.BAD, words, fix),)
    return (
        _seen(target, measured),
        _relative(target, measured),
        _aspect(measured[0], intrinsics),
        _absolute(measured[0], None if intrinsics is None else distance),
        _flatness(measured, is_calibrated=intrinsics is not None),
        _sharpness(measured),
        *_light_and_rim(pixels, measured),
    )


def softness(pixels: Grey, corners: Array, cells: int) -> float | None:
    """How soft the edges of a tag of `cells` a side are, as a share of a cell [1]; None where they do not show."""
    found = [spread for _, spread in _edges(pixels, corners, cells)]
    return float(np.median(found)) / (mean_side(corners) / cells) if found else None


def _judged(name: str, words: str, fix: str, *, is_bad: bool) -> PrintFinding:
    """What figures say; what to do only where they are bad."""
    return PrintFinding(name, PrintState.BAD, words, fix) if is_bad else PrintFinding(name, PrintState.GOOD, words)


def _measure(pixels: Grey, tag: Tag, seen: Detection, projection: Projection | None) -> _Measured | None:
    """Measure the four sides of a tag; None where an edge is not there."""
    edges = _edges(pixels, seen.corners, tag.family.size_cells)
    if len(edges) < len(seen.corners):
        return None
    sides, blurs = zip(*edges, strict=True)
    straight = [points if projection is None else projection.undistort(points) for points in sides]
    bows, noises = zip(*map(_bow, straight), strict=True)
    corners, raw = _quad(straight), _quad(sides)
    side = mean_side(raw)
    noise = float(np.mean(noises)) * side / mean_side(corners)
    return _Measured(tag, corners, raw, np.array(bows), noise, float(np.median(blurs)), side)


def _edges(pixels: Grey, corners: Array, cells: int) -> list[tuple[Array, float]]:
    """Places of the edges along the sides of a tag, and how soft they are; see `_edge`. Those that show."""
    image, chords = pixels.astype(np.float32), np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-chords[:, 1], chords[:, 0]]) / np.linalg.norm(chords, axis=1)[:, None]
    # two corners lie on a side; the nearer one of the others says how far the quad reaches behind it
    depths = np.sort(np.abs(corners @ normals.T - (normals * corners).sum(axis=1)), axis=0)[2]
    reaches = np.maximum(0.6 * depths / cells, 1.5).tolist()
    edges = [_edge(image, *ends) for ends in zip(corners, chords, normals, reaches, strict=True)]
    return [edge for edge in edges if edge is not None]


def _edge(
    image: npt.NDArray[np.float32], start: Array, chord: Array, normal: Array, reach: float
) -> tuple[Array, float] | None:
    """Places of the edge along a side `(n, 2)` [px], and how soft it is [px]; None where less than half of it shows."""
    along = np.linspace(SKIPPED, 1.0 - SKIPPED, ALONG)
    steps = np.arange(-reach, reach + 0.25, 0.25)
    base = start + along[:, None] * chord
    places = (base[:, None, :] + steps[None, :, None] * normal).astype(np.float32)
    profile = cv2.remap(image, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slope = np.gradient(profile.astype(np.float64), 0.25, axis=1)
    rise = profile[:, -3:].mean(axis=1) - profile[:, :3].mean(axis=1)
    weight = np.maximum(slope * np.sign(np.median(rise)), 0.0) ** 2
    total = weight.sum(axis=1)
    good = (np.abs(rise) > EDGE_SHARE * np.median(np.abs(rise))) & (total > 0.0) & (np.abs(rise) > EDGE_GREY)
    if good.sum() < ALONG // 2:
        return None
    weight = weight[good] / total[good, None]
    middle = (weight * steps).sum(axis=1)
    # The square of a bell's slope is narrower than the bell by the root of two.
    spread = np.sqrt(2.0 * (weight * (steps - middle[:, None]) ** 2).sum(axis=1))
    return base[good] + middle[:, None] * normal, float(np.median(spread))


def _line(points: Array) -> tuple[Array, Array]:
    """A point and the direction of the line through points."""
    middle = points.mean(axis=0)
    return middle, np.asarray(np.linalg.svd(points - middle)[2][0], np.float64)


def _quad(sides: Sequence[Array]) -> Array:
    """Where neighbouring sides meet `(4, 2)`, by points along each."""
    lines = [_line(points) for points in sides]
    pairs = zip([lines[-1], *lines], lines, strict=False)
    return np.array([a + u * np.linalg.solve(np.column_stack([u, -v]), b - a)[0] for (a, u), (b, v) in pairs])


def _bow(points: Array) -> tuple[float, float]:
    """How far the middle of a side leaves its chord, as a share of its length, and the scatter about that."""
    middle, direction = _line(points)
    place = (points - middle) @ direction
    off = (points - middle) @ np.array([-direction[1], direction[0]])
    half = 0.5 * float(np.ptp(place))
    parabola = np.polyfit(place / half, off, 2)
    scatter = float(np.std(off - np.polyval(parabola, place / half)))
    return float(parabola[0]) / (2.0 * half), scatter


def _flat(tag: Tag, base: Tag) -> Array:
    """Corners of a tag in the plane of another `(4, 2)` [m]."""
    return np.asarray((tag.corners - base.position) @ base.rotation[:, :2], np.float64)


def _seen(target: Target, measured: Sequence[_Measured]) -> PrintFinding:
    names = ", ".join(f"{one.tag.tag_id} ({one.cell:.1f} px a cell)" for one in measured)
    words = f"{len(measured)} of {len(target.tags)} measured: {names}"
    is_far = measured[0].cell < LEAST_CELL
    if len(measured) < len(target.tags) and not is_far:
        return PrintFinding("tags", PrintState.UNKNOWN, words, "Take another photograph that shows the others.")
    return _judged("tags", words, "Take the photograph nearer: every figure below is loose.", is_bad=is_far)


def _relative(target: Target, measured: Sequence[_Measured]) -> PrintFinding:
    """Sizes and places of the other tags, by the largest one."""
    base, others = measured[0], [one for one in measured[1:] if one.is_sharp]
    name = "sizes among tags"
    if len(others) < len(measured) - 1:
        words = "the others are too blurred to compare" if base.is_sharp else "the tags are too blurred to compare"
        return PrintFinding(name, PrintState.UNKNOWN, words, "Take a sharp photograph, nearer.")
    if not others or not target.is_planar:
        words = "one tag in view: nothing to compare it with" if target.is_planar else "its tags are not in one plane"
        return PrintFinding(name, PrintState.UNKNOWN, words, "Measure the tag with a ruler.")
    back = np.asarray(np.linalg.inv(_axes(base.corners, base.tag)), np.float64)
    worst, is_bad = [], False
    for one in others:
        placed = carry(back, one.corners)
        off = float(np.linalg.norm(placed.mean(axis=0) - _flat(one.tag, base.tag).mean(axis=0)))
        loose = 100 * math.hypot(one.corner_sd / one.side, base.corner_sd / base.side)
        percent = 100 * (mean_side(placed) / one.tag.size - 1.0)
        displaced, unsure = 100 * off / base.tag.size, 300 * base.corner_sd / base.side
        is_bad |= abs(percent) > max(SCALE_PERCENT, 3 * loose) or displaced > max(SCALE_PERCENT, unsure)
        worst.append(
            f"{one.tag.tag_id} is {percent:+.2f} +- {loose:.2f} % of its size, {1000 * off:.1f} mm off its place"
        )
    fix = "Write the sizes and places that a ruler shows into the target file, or print it anew."
    return _judged(name, f"against tag {base.tag.tag_id}: {'; '.join(worst)}", fix, is_bad=is_bad)


def _axes(corners: Array, tag: Tag) -> Array:
    """Image of the plane's unit axes and origin at unit depth, up to one factor `(3, 3)`."""
    return np.asarray(cv2.findHomography(_flat(tag, tag), corners)[0], np.float64)


def _aspect(base: _Measured, intrinsics: Intrinsics | None) -> PrintFinding:
    """Whether a square tag is as wide as it is high."""
    name = "width over height"
    if intrinsics is None:
        words = "without a camera file a tilt looks like a print that is too narrow"
        return PrintFinding(name, PrintState.UNKNOWN, words, "Give --camera, or measure both sides with a ruler.")

    def ratio(corners: Array) -> float:
        axes = _axes(corners, base.tag)
        return float(np.linalg.norm(axes[:, 0]) / np.linalg.norm(axes[:, 1]))

    here, step = ratio(base.corners), base.corner_sd / (0.5 * (intrinsics.fx + intrinsics.fy))
    slopes = []
    for place in np.ndindex(base.corners.shape):
        moved = base.corners.copy()
        moved[place] += step
        slopes.append(ratio(moved) - here)
    percent, loose = 100 * (here - 1.0), 100 * float(np.linalg.norm(slopes))
    words = f"{percent:+.2f} +- {loose:.2f} % by tag {base.tag.tag_id}"
    if loose > 2 * SCALE_PERCENT:
        return PrintFinding(
            name, PrintState.UNKNOWN, words, "Take a photograph that is nearer and more from the front."
        )
    is_bad = abs(percent) > max(SCALE_PERCENT, 3 * loose)
    return _judged(name, words, "Print it anew at 100 %, without fitting to the page.", is_bad=is_bad)


def _absolute(base: _Measured, distance: float | None) -> PrintFinding:
    """How large the print is, by a distance that somebody measured to a camera with a file."""
    name = "size"
    ruler = f"Measure tag {base.tag.tag_id} with a ruler: {1000 * base.tag.size:.1f} mm by its file."
    if distance is None:
        words = "one photograph cannot tell sizes that are all wrong by one factor"
        return PrintFinding(name, PrintState.UNKNOWN, words, f"{ruler} Or give --camera and --distance by tape.")
    axes = _axes(base.corners, base.tag)
    depth = float(np.linalg.norm(axes[:, 2])) / (0.5 * float(np.linalg.norm(axes[:, 0]) + np.linalg.norm(axes[:, 1])))
    percent = 100 * (distance / depth - 1.0)
    loose = 100 * math.hypot(TAPE, base.corner_sd / base.side)
    words = f"{percent:+.2f} +- {loose:.2f} %: the image says {depth:.3f} m, the tape {distance:.3f} m"
    return _judged(name, words, ruler, is_bad=abs(percent) > max(SCALE_PERCENT, 2 * loose))


def _flatness(measured: Sequence[_Measured], *, is_calibrated: bool) -> PrintFinding:
    """Whether sides are straight."""
    name = "flat"
    sharp = [one for one in measured if one.is_sharp]
    if not sharp:
        words = "the edges are too blurred to see a bend"
        return PrintFinding(name, PrintState.UNKNOWN, words, "Take a sharp photograph, nearer.")
    one = max(sharp, key=lambda one: one.bend)
    percent, loose = one.bow
    words = (
        f"the most bent side of tag {one.tag.tag_id} leaves its chord by {percent:.2f} +- {loose:.2f} % of its length"
    )
    if one.bend <= 1.0:
        words += "; a bend that the camera looks along stays hidden"
        return PrintFinding(name, PrintState.GOOD, words, "A second photograph from another side tells.")
    if not is_calibrated:
        words += ", but lenses bend lines, too"
        return PrintFinding(name, PrintState.UNKNOWN, words, "Give --camera; glue the print to something flat.")
    return PrintFinding(name, PrintState.BAD, words, "Glue the print to something flat.")


def _sharpness(measured: Sequence[_Measured]) -> PrintFinding:
    one = max(measured, key=lambda one: one.blur / one.cell)
    cells = one.blur / one.cell
    words = f"edges of tag {one.tag.tag_id} are {one.blur:.2f} px soft, {cells:.2f} of its cells"
    fix = "Focus, hold still, take it nearer; if a sharp photograph says the same, print with a better printer."
    return _judged("sharp", words, fix, is_bad=cells > BLUR_CELLS)


def _light_and_rim(pixels: Grey, measured: Sequence[_Measured]) -> Iterator[PrintFinding]:
    rims = [(levels, one) for one in measured if (levels := _rim(pixels, one)) is not None]
    if not rims:
        fix = "Show more of the paper around the tags."
        yield PrintFinding("white rim", PrintState.UNKNOWN, "the rim is not in the photograph", fix)
        return
    black, white, _ = np.median([levels for levels, _ in rims], axis=0)
    words = f"black is {black:.0f}, white {white:.0f} of 255"
    is_dark = white - black < CONTRAST
    fix = "More light, or a darker print." if is_dark else "Expose less: blown white moves every edge."
    yield _judged("light", words, fix, is_bad=is_dark or white > BLOWN)
    share, one = min(((levels[2], one) for levels, one in rims), key=lambda pair: pair[0])
    words = f"{100 * share:.0f} % of one cell around tag {one.tag.tag_id} is white"
    fix = "Leave one cell of white around everything black; remove what lies on it."
    yield _judged("white rim", words, fix, is_bad=share < WHITE_SHARE)


def _rim(pixels: Grey, one: _Measured) -> tuple[float, float, float] | None:
    """Black, white, and how many of the cells around are white; None where they leave the image."""
    family = one.tag.family
    n, shift = family.black_cells, (family.size_cells - family.black_cells) / 2
    ahead = image_from_cells(one.raw, family.size_cells) @ np.array(
        [[1.0, 0.0, shift], [0.0, 1.0, shift], [0.0, 0.0, 1.0]]
    )
    ends = carry(ahead, np.array([[-0.5, -0.5], [n + 0.5, -0.5], [n + 0.5, n + 0.5], [-0.5, n + 0.5]]))
    height, width = pixels.shape
    if (ends < 0.0).any() or (ends > (width - 1, height - 1)).any():
        return None
    values = cell_values(pixels, ahead, n)
    light, dark = np.concatenate([values[[0, -1]].ravel(), values[1:-1, [0, -1]].ravel()]), values[1:-1, 1:-1]
    white, black = float(np.percentile(light, 75)), float(np.percentile(dark, 25))
    middle = 0.5 * (white + black)
    return black, white, float((light > middle).mean())
