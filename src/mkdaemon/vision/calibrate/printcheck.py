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

from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.tags.cellread import carry, sample
from mkdaemon.vision.tags.cover import covered_cells
from mkdaemon.vision.tags.detection import Detection
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.searchplan import Stage
from mkdaemon.vision.tags.tagfamily import QUIET_ZONE_CELLS
from mkdaemon.vision.tags.tagmap import Tag, TagMap, Target

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

STAGES: Final[tuple[Stage, ...]] = ("decimate1", "log", "decimate2", "linear")
"""Searches for whole tags, the finest first."""
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
    """One check.

    Attributes:
        name: what was looked at.
        state: what was found.
        words: the figures, one sentence.
        fix: what to do; empty where nothing has to be done.
    """

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
        loose = max(3.0 * self.noise / math.sqrt(ALONG), LEAST_BOW) / self.side
        return 100 * float(np.abs(self.bows).max()), 100 * loose

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
    found = _find(pixels, target)
    measured = [one for tag, seen in found if (one := _measure(pixels, tag, seen, projection)) is not None]
    if not measured:
        words = "no tag of the target was found in the photograph"
        fix = "Show the whole print, sharp, filling half of the photograph; check --target."
        return (PrintFinding("tags", PrintState.BAD, words, fix),)
    focal = 1.0 if intrinsics is None else 0.5 * (intrinsics.fx + intrinsics.fy)
    return (
        _seen(target, measured),
        _relative(target, measured),
        _aspect(measured[0], focal, is_calibrated=projection is not None),
        _absolute(measured[0], distance, is_calibrated=projection is not None),
        _flatness(measured, is_calibrated=projection is not None),
        _sharpness(measured),
        *_light_and_rim(pixels, measured),
    )


def softness(pixels: Grey, corners: Array, cells: int) -> float | None:
    """How soft the edges of a tag are, as a share of a cell [1]; None where they do not show.

    Args:
        pixels: `(h, w)` uint8.
        corners: of the tag `(4, 2)` [px].
        cells: on its side.
    """
    found = [spread for _, spread in _edges(pixels, corners, cells)]
    return float(np.median(found)) / (_side(corners) / cells) if found else None


def _find(pixels: Grey, target: Target) -> list[tuple[Tag, Detection]]:
    """Tags of the target, largest in the image first."""
    tagmap = TagMap((target,))
    detector = Detector(tagmap.whitelist, covered=covered_cells(tagmap))
    found: dict[tuple[str, int], Detection] = {}
    for stage in (stage for stage in STAGES if stage in detector.stages):
        for seen in detector.search_all(pixels, stage):
            found.setdefault((seen.family, seen.tag_id), seen)
    pairs = [(tagmap.owners[key][1], seen) for key, seen in found.items()]
    return sorted(pairs, key=lambda pair: -pair[1].side_px)


def _measure(pixels: Grey, tag: Tag, seen: Detection, projection: Projection | None) -> _Measured | None:
    """Measure the four sides of a tag; None where an edge is not there."""
    edges = _edges(pixels, seen.corners, tag.family.size_cells)
    if len(edges) < len(seen.corners):
        return None
    sides, blurs = zip(*edges, strict=True)
    straight = [points if projection is None else projection.undistort(points) for points in sides]
    bows, noises = zip(*map(_bow, straight), strict=True)
    corners, raw = _quad(straight), _quad(sides)
    noise = float(np.mean(noises)) * _side(raw) / _side(corners)
    return _Measured(tag, corners, raw, np.array(bows), noise, float(np.median(blurs)), _side(raw))


def _side(corners: Array) -> float:
    """Mean length of the sides of a quad."""
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())


def _edges(pixels: Grey, corners: Array, cells: int) -> list[tuple[Array, float]]:
    """Places of the edges along the sides of a tag, and how soft they are; see `_edge`. Those that show."""
    image = pixels.astype(np.float32)
    reaches = np.maximum(0.6 * _depths(corners) / cells, 1.5).tolist()
    edges = [_edge(image, *ends) for ends in zip(corners, np.roll(corners, -1, axis=0), reaches, strict=True)]
    return [edge for edge in edges if edge is not None]


def _depths(corners: Array) -> Array:
    """How far a quad reaches behind each of its sides, at its nearer end `(4,)` [px]."""
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.linalg.norm(sides, axis=1)[:, None]
    before = np.abs(((np.roll(corners, 1, axis=0) - corners) * normals).sum(axis=1))
    after = np.abs(((np.roll(corners, -2, axis=0) - np.roll(corners, -1, axis=0)) * normals).sum(axis=1))
    return np.asarray(np.minimum(before, after), np.float64)


def _edge(image: npt.NDArray[np.float32], start: Array, end: Array, reach: float) -> tuple[Array, float] | None:
    """Places of the edge along a side `(n, 2)` [px], and how soft it is [px]; None where less than half of it shows."""
    along = np.linspace(SKIPPED, 1.0 - SKIPPED, ALONG)
    chord = end - start
    normal = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
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
    direction = np.linalg.svd(points - middle)[2][0]
    return middle, np.asarray(direction if direction @ (points[-1] - points[0]) > 0 else -direction, np.float64)


def _quad(sides: Sequence[Array]) -> Array:
    """Where neighbouring sides meet `(4, 2)`, by points along each."""
    corners = []
    lines = [_line(points) for points in sides]
    for number in range(4):
        (a, u), (b, v) = lines[number - 1], lines[number]
        corners.append(a + u * np.linalg.solve(np.column_stack([u, -v]), b - a)[0])
    return np.array(corners)


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
    if measured[0].cell < LEAST_CELL:
        return PrintFinding("tags", PrintState.BAD, words, "Take the photograph nearer: every figure below is loose.")
    if len(measured) < len(target.tags):
        return PrintFinding("tags", PrintState.UNKNOWN, words, "Take another photograph that shows the others.")
    return PrintFinding("tags", PrintState.GOOD, words)


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
    worst, state = [], PrintState.GOOD
    for one in others:
        placed = carry(back, one.corners)
        off = float(np.linalg.norm(placed.mean(axis=0) - _flat(one.tag, base.tag).mean(axis=0)))
        loose = 100 * math.hypot(one.corner_sd / one.side, base.corner_sd / base.side)
        percent = 100 * (_side(placed) / one.tag.size - 1.0)
        limit = max(SCALE_PERCENT, 3 * loose)
        displaced = 100 * off / base.tag.size
        allowed = max(SCALE_PERCENT, 300 * base.corner_sd / base.side)
        is_off = displaced > allowed
        if abs(percent) > limit or is_off:
            state = PrintState.BAD
        worst.append(
            f"{one.tag.tag_id} is {percent:+.2f} +- {loose:.2f} % of its size, {1000 * off:.1f} mm off its place"
        )
    fix = (
        "Write the sizes and places that a ruler shows into the target file, or print it anew."
        if state is PrintState.BAD
        else ""
    )
    return PrintFinding(name, state, f"against tag {base.tag.tag_id}: {'; '.join(worst)}", fix)


def _axes(corners: Array, tag: Tag) -> Array:
    """Image of the plane's unit axes and origin at unit depth, up to one factor `(3, 3)`."""
    return np.asarray(cv2.findHomography(_flat(tag, tag), corners)[0], np.float64)


def _aspect(base: _Measured, focal: float, *, is_calibrated: bool) -> PrintFinding:
    """Whether a square tag is as wide as it is high."""
    name = "width over height"
    if not is_calibrated:
        words = "without a camera file a tilt looks like a print that is too narrow"
        return PrintFinding(name, PrintState.UNKNOWN, words, "Give --camera, or measure both sides with a ruler.")

    def ratio(corners: Array) -> float:
        axes = _axes(corners, base.tag)
        return float(np.linalg.norm(axes[:, 0]) / np.linalg.norm(axes[:, 1]))

    here, step = ratio(base.corners), base.corner_sd / focal
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
    if abs(percent) > max(SCALE_PERCENT, 3 * loose):
        return PrintFinding(name, PrintState.BAD, words, "Print it anew at 100 %, without fitting to the page.")
    return PrintFinding(name, PrintState.GOOD, words)


def _absolute(base: _Measured, distance: float | None, *, is_calibrated: bool) -> PrintFinding:
    """How large the print is, by a distance that somebody measured."""
    name = "size"
    ruler = f"Measure tag {base.tag.tag_id} with a ruler: {1000 * base.tag.size:.1f} mm by its file."
    if not is_calibrated or distance is None:
        words = "one photograph cannot tell sizes that are all wrong by one factor"
        return PrintFinding(name, PrintState.UNKNOWN, words, f"{ruler} Or give --camera and --distance by tape.")
    axes = _axes(base.corners, base.tag)
    depth = float(np.linalg.norm(axes[:, 2])) / (0.5 * float(np.linalg.norm(axes[:, 0]) + np.linalg.norm(axes[:, 1])))
    percent = 100 * (distance / depth - 1.0)
    loose = 100 * math.hypot(TAPE, base.corner_sd / base.side)
    words = f"{percent:+.2f} +- {loose:.2f} %: the image says {depth:.3f} m, the tape {distance:.3f} m"
    if abs(percent) > max(SCALE_PERCENT, 2 * loose):
        return PrintFinding(name, PrintState.BAD, words, ruler)
    return PrintFinding(name, PrintState.GOOD, words)


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
    if cells > BLUR_CELLS:
        fix = "Focus, hold still, take it nearer; if a sharp photograph says the same, print with a better printer."
        return PrintFinding("sharp", PrintState.BAD, words, fix)
    return PrintFinding("sharp", PrintState.GOOD, words)


def _light_and_rim(pixels: Grey, measured: Sequence[_Measured]) -> Iterator[PrintFinding]:
    rims = [(levels, one) for one in measured if (levels := _rim(pixels, one)) is not None]
    if not rims:
        fix = "Show more of the paper around the tags."
        yield PrintFinding("white rim", PrintState.UNKNOWN, "the rim is not in the photograph", fix)
        return
    black, white, _ = np.median([levels for levels, _ in rims], axis=0)
    words = f"black is {black:.0f}, white {white:.0f} of 255"
    if white - black < CONTRAST:
        yield PrintFinding("light", PrintState.BAD, words, "More light, or a darker print.")
    elif white > BLOWN:
        yield PrintFinding("light", PrintState.BAD, words, "Expose less: blown white moves every edge.")
    else:
        yield PrintFinding("light", PrintState.GOOD, words)
    share, one = min(((levels[2], one) for levels, one in rims), key=lambda pair: pair[0])
    words = f"{100 * share:.0f} % of one cell around tag {one.tag.tag_id} is white"
    state = PrintState.GOOD if share >= WHITE_SHARE else PrintState.BAD
    fix = "Leave one cell of white around everything black; remove what lies on it." if state is PrintState.BAD else ""
    yield PrintFinding("white rim", state, words, fix)


def _rim(pixels: Grey, one: _Measured) -> tuple[float, float, float] | None:
    """Black, white, and how much of the white rim is white; None where the rim leaves the image."""
    tag = one.tag
    ahead = _axes(one.raw, tag)
    half = 0.5 * tag.module * tag.family.black_cells
    rim = _ring(half + 0.5 * QUIET_ZONE_CELLS * tag.module, ahead)
    height, width = pixels.shape
    if (rim < 0.0).any() or (rim[:, 0] > width - 1).any() or (rim[:, 1] > height - 1).any():
        return None
    inside = _ring(half - 0.5 * tag.module, ahead)
    light, dark = sample(pixels, rim), sample(pixels, inside)
    white, black = float(np.percentile(light, 75)), float(np.percentile(dark, 25))
    middle = 0.5 * (white + black)
    return black, white, float((light > middle).mean())


def _ring(half: float, ahead: Array) -> Array:
    """Places on a square around the middle of a tag, in the image `(n, 2)` [px]."""
    along = np.linspace(-half, half, 33)
    side = np.full_like(along, half)
    square = np.vstack(
        [np.column_stack(pair) for pair in ((along, side), (side, along), (along, -side), (-side, along))]
    )
    return carry(ahead, square)
