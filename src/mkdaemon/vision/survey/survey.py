"""A survey: which tags a room has and where, from images that show some of them together.

What is measured says when it is wrong. A tag that was moved, of another side than was given, or printed twice does not
fit what the others say; the worst is named and left out, and the rest is adjusted again.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

import numpy as np

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import in_light
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.rolling import skew
from mkdaemon.vision.still import ANY_ID_FALSE_RATE
from mkdaemon.vision.survey.bundle import LARGE, TAG, Adjusted, Bundle, Indices, Sightings, adjust
from mkdaemon.vision.survey.start import Beginner, Seen, sightings
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Tag

BORDER_PX: Final = 4.0
"""A tag with a corner nearer to the border of the image is left out: what lies behind the border moves the corner."""
LEAST_IMAGES: Final = 5
"""Images in which a tag was seen at least: a code misread in one or two of a thousand images is no tag."""
STRANGE_SHARE: Final = 0.1
"""Share of a tag's sightings that may lie far off: blur, a rolling shutter, a hand in front of it."""
FAR_PX: Final = 1.0
"""Residual from which a sighting shows a tag elsewhere [px]: a lens known to a few tenths of a pixel shows less."""
WRONG_SIDE: Final = 0.02
"""A side that differs by more from what was given was measured wrong, as a share,"""
CERTAIN: Final = 4.0
"""and by more than this many deviations."""
NOT_MOVED: Final = 0.15
"""Share of its sightings that a tag which was moved once may contradict; one that exists twice contradicts more."""
FLAT: Final = np.cos(np.radians(10.0))
"""Cosine of the angle up to which a tag lies as the origin does."""
LINE: Final = 0.1
"""Tags whose second extent is less than this share of their first lie in a line, which has no normal."""
WEAK: Final = 3.0
"""A place whose deviation is this many times the median one is weakly tied."""


class TagFault(StrEnum):
    """Why a tag is not in the map."""

    MOVED = "moved"
    """It lay elsewhere in a part of the images."""
    TWICE = "twice"
    """Two tags have this code."""
    WRONG_SIDE = "wrong_side"
    """Its side is not what was given."""
    UNTIED = "untied"
    """No image shows it together with a tag that is tied to the origin."""
    RARE = "rare"
    """Fewer than five images show it."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A tag that is not in the map.

    Attributes:
        family: of its code.
        tag_id: its code.
        fault: why.
        words: what was seen, and what to do.
    """

    family: str
    tag_id: int
    fault: TagFault
    words: str


@dataclass(frozen=True, slots=True, eq=False)
class Surveyed:
    """One tag of the map.

    Attributes:
        tag: where it is, with the side that was given.
        place_sd: deviations of its middle `(3,)` [m; map].
        turn_sd: deviations of its turn `(3,)` [rad; map].
        images: that show it.
        rms_px: of its corners [px].
        together_with: how many other tags some image shows with it.
    """

    tag: Tag
    place_sd: Array
    turn_sd: Array
    images: int
    rms_px: float
    together_with: int


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What a survey found.

    Attributes:
        tags: of the map, the origin first.
        left_out: and why.
        images: used.
        rms_px: of all corners that are not far off [px].
        corner_sd: deviation of a corner [px].
        scale: by which the map was stretched to fit a measured distance; 1 without one.
        centres: where the camera was `(i, 3)` [m; map].
        weak: codes of tags that are weakly tied, the weakest first, with what to look at once more.
    """

    tags: tuple[Surveyed, ...]
    left_out: tuple[LeftOut, ...]
    images: int
    rms_px: float
    corner_sd: float
    scale: float
    centres: Array
    weak: tuple[tuple[int, str], ...]


@dataclass(frozen=True, slots=True)
class KnownTags:
    """What is known of the tags before.

    Attributes:
        size: side of each [m].
        sizes: of those that have another one, by their codes [m].
        family: of all of them.
        origin: code of the tag in whose middle the map's origin lies; None takes the one that most images show.
        distances: that were measured between the middles of two tags, by their codes [m].
    """

    size: float
    sizes: Mapping[int, float]
    family: str = "tag36h11"
    origin: int | None = None
    distances: Mapping[tuple[int, int], float] = field(default_factory=dict)


def look_at(images: Iterable[Grey], intrinsics: Intrinsics, family: str, threads: int) -> Iterator[list[Detection]]:
    """Yield the tags of each image `(h, w)` uint8, in order; libapriltag computes outside the interpreter's lock.

    Raises:
        VisionError: an unknown family.
    """
    detector = Detector({family: frozenset(range(find_family(family).ids))}, max_chance=ANY_ID_FALSE_RATE)
    waiting: deque[Future[list[Detection]]] = deque()
    far = np.array([intrinsics.width, intrinsics.height]) - 1.0 - BORDER_PX

    def look(pixels: Grey) -> list[Detection]:
        found = detector.search_all(in_light(pixels, intrinsics.gamma))
        return [one for one in found if ((one.corners >= BORDER_PX) & (one.corners <= far)).all()]

    with ThreadPoolExecutor(threads) as pool:
        for pixels in images:
            waiting.append(pool.submit(look, pixels))
            if len(waiting) > 2 * threads:  # images take memory: few wait at a time
                yield waiting.popleft().result()
        yield from (each.result() for each in waiting)


def survey(
    images: Sequence[Sequence[Detection]],
    wanted: KnownTags,
    projection: Projection,
    progress: Callable[[float], None] = lambda share: None,
) -> Survey:
    """Find where the tags are that images show.

    The map's origin is the middle of one tag, its x axis that tag's; its z axis is the normal of the plane of the tags
    that lie as this one does, where there are three.

    Args:
        images: the tags of each image, in the order in which they were taken.
        wanted: what is known before.
        projection: of the camera, which held still while an image was exposed.
        progress: takes the share of the adjustment that is done.

    Raises:
        VisionError: too little is seen, the origin is left out, or a distance is between tags that are not in the map.
    """
    counts = Counter(code for image in images for code in {found.tag_id for found in image})
    doubled = Counter(
        code for image in images for code, often in Counter(found.tag_id for found in image).items() if often > 1
    )
    left_out = [
        _of(wanted, code, TagFault.TWICE, f"{often} images show two of it")
        for code, often in sorted(doubled.items())
        if often > 1
    ]
    gone = {one.tag_id for one in left_out}
    left_out += [
        _of(wanted, code, TagFault.RARE, f"{often} of {len(images)} images show it")
        for code, often in sorted(counts.items())
        if often < LEAST_IMAGES and code not in gone
    ]
    gone = {one.tag_id for one in left_out}
    codes = sorted(counts.keys() - gone)
    if not codes or (wanted.origin is not None and wanted.origin not in codes):
        raise VisionError(_no_origin(wanted.origin, counts, left_out))
    index = {code: k for k, code in enumerate(codes)}
    family = find_family(wanted.family)
    tags = [Tag(family, code, wanted.sizes.get(code, wanted.size), np.zeros(3), np.eye(3)) for code in codes]
    shown = [
        [(index[found.tag_id], found) for found in image if found.tag_id in index and not _is_doubled(found, image)]
        for image in images
    ]
    return _Work(shown, tags, wanted, projection, progress).survey(left_out)


def _is_doubled(found: Detection, image: Sequence[Detection]) -> bool:
    return sum(other.tag_id == found.tag_id for other in image) > 1


def _of(wanted: KnownTags, code: int, fault: TagFault, words: str) -> LeftOut:
    return LeftOut(wanted.family, code, fault, words)


def _no_origin(origin: int | None, counts: Mapping[int, int], left_out: Sequence[LeftOut]) -> str:
    """Why a survey cannot begin."""
    if not counts:
        return "no image shows a tag: check --family, light and focus"
    if origin is None:
        return f"no tag is seen in {LEAST_IMAGES} images or more: take more images of each, several tags together"
    why = next((one.words for one in left_out if one.tag_id == origin), "no image shows it")
    return f"tag {origin} cannot be the origin: {why}; give another one with --origin"


@dataclass(frozen=True, slots=True, eq=False)
class _Done:
    """An adjustment: of which sightings, and which tags, the origin first."""

    adjusted: Adjusted
    seen: Sightings
    order: list[int]

    @property
    def tied(self) -> Set[int]:
        """Tags whose place is known."""
        return set(self.order)


class _Work:
    """One survey: what it was given, and the adjustment that is repeated without what does not fit."""

    def __init__(
        self,
        shown: Sequence[Seen],
        tags: Sequence[Tag],
        wanted: KnownTags,
        projection: Projection,
        progress: Callable[[float], None],
    ) -> None:
        self._shown, self._tags, self._wanted = shown, tags, wanted
        self._projection, self._progress = projection, progress
        self._given = np.array([tag.size for tag in tags])
        self._beginner = Beginner(shown, tags, projection)

    def survey(self, left_out: list[LeftOut]) -> Survey:
        """Adjust, leave out the worst that does not fit, and again."""
        words = "images show it far apart: two tags have this code, or it was carried about"
        strange = {tag: self._left_out(tag, TagFault.TWICE, words) for tag in self._elsewhere()}
        while (worst := self._worst(done := self._adjusted(strange.keys()))) is not None:
            strange[worst[0]] = worst[1]
        # What is always seen beside a tag that was moved contradicts it as often, and was perhaps named before it.
        for tag in list(strange)[:-1]:
            again = self._adjusted(strange.keys() - {tag})
            if tag in again.tied and self._worst(again) is None:
                done = again
                del strange[tag]
        left_out = [*left_out, *strange.values()]
        words = "no image shows it together with a tag of the map: take some that do"
        untied = set(range(len(self._tags))) - done.tied - strange.keys()
        left_out += [self._left_out(tag, TagFault.UNTIED, words) for tag in untied]
        return self._result(done, left_out)

    def _adjusted(self, without: Set[int]) -> _Done:
        """The map without some tags."""
        origin = self._origin_of(without)
        start, tied, images = self._beginner.begin(origin, without)
        if len(tied) < 2:
            msg = f"no image shows tag {self._tags[origin].tag_id} together with another tag of the map"
            raise VisionError(f"{msg}: take images that show two or more at once")
        seen = sightings(self._shown, tied, images)
        adjusted = adjust(start, seen, self._given, self._projection, origin, self._progress)
        return _Done(adjusted, seen, sorted(tied, key=lambda tag: (tag != origin, tag)))

    def _left_out(self, tag: int, fault: TagFault, words: str) -> LeftOut:
        return _of(self._wanted, self._tags[tag].tag_id, fault, words)

    def _elsewhere(self) -> set[int]:
        """Tags without which the ways from tag to tag close: each was at two places that are far apart."""
        without: set[int] = set()

        def broken(more: set[int]) -> int:
            return self._beginner.contradictions(self._origin_of(more), more)

        while (now := broken(without)) and len(without) + 2 < len(self._tags):
            left = [tag for tag in range(len(self._tags)) if tag not in without]
            fewest, tag = min((broken(without | {tag}), tag) for tag in left)
            if 2 * fewest > now:
                break
            without.add(tag)
        return without

    def _origin_of(self, without: Set[int]) -> int:
        """The tag that was asked for, or the one that most images show."""
        counts = Counter(tag for image in self._shown for tag, _ in image if tag not in without)
        if not counts:
            raise VisionError("no tag is left that fits the others: fix them and take the images again")
        asked = [tag for tag in counts if self._tags[tag].tag_id == self._wanted.origin]
        return asked[0] if asked else max(counts, key=lambda tag: (counts[tag], -tag))

    def _worst(self, done: _Done) -> tuple[int, LeftOut] | None:
        """The tag that fits worst, and why it does not; none where all fit.

        Of two tags that contradict each other in one image either may be explained and the other not: the image counts
        against both, and the tag whose images count most is the one that all the others contradict.
        """
        adjusted, seen = done.adjusted, done.seen
        found: list[tuple[float, int, TagFault, str]] = []
        _, of_image, together = np.unique(seen.images, return_inverse=True, return_counts=True)
        contradicts = np.zeros(len(together), dtype=bool)
        contradicts[of_image[_far(adjusted)]] = True
        for tag in done.order:
            rows = (seen.tags == tag) & (together[of_image] > 1)
            far, images = contradicts[of_image[rows]], seen.images[rows]
            off = float(np.log(adjusted.bundle.sides[tag] / self._given[tag]))
            off_sd = float(np.sqrt(adjusted.covariance[TAG * tag + 6, TAG * tag + 6]))
            if far.mean() > STRANGE_SHARE:
                found.append((float(far.mean()) / STRANGE_SHARE, tag, *_displaced(far, images)))
            elif abs(off) > max(WRONG_SIDE, CERTAIN * off_sd):
                side, given = adjusted.bundle.sides[tag], self._given[tag]
                words = f"its side is {side:.4f} m by the others, {given:g} m was given; keep it with --sizes"
                found.append((abs(off) / WRONG_SIDE, tag, TagFault.WRONG_SIDE, words))
        if not found:
            return None
        _, tag, fault, words = max(found)
        code = self._tags[tag].tag_id
        if code == self._wanted.origin:
            raise VisionError(f"tag {code} cannot be the origin: {words}; give another one with --origin")
        return tag, self._left_out(tag, fault, words)

    def _result(self, done: _Done, left_out: Sequence[LeftOut]) -> Survey:
        """The map in its frame."""
        adjusted, seen, order = done.adjusted, done.seen, done.order
        bundle, covariances = adjusted.bundle, free_covariances(adjusted, order)
        factor = self._factor(bundle, order)
        level = _level(bundle, order)
        places = bundle.places @ level.T * factor
        found = []
        for k, tag in enumerate(order):
            rows = seen.tags == tag
            sds = [
                np.sqrt(np.maximum(np.diag(level @ covariances[k][part, part] @ level.T), 0.0))
                for part in (slice(0, 3), slice(3, 6))
            ]
            one = replace(
                self._tags[tag],
                size=self._given[tag] * factor,
                position=places[tag],
                rotation=level @ bundle.turns[tag],
            )
            rms = float(np.sqrt(2.0 * np.median((adjusted.residuals[rows] ** 2).mean(axis=(1, 2)))))
            neighbours = len(self._beginner.neighbours(tag) & set(order))
            found.append(Surveyed(one, sds[0] * factor, sds[1], int(rows.sum()), rms, neighbours))
        fits = ~_far(adjusted)
        used = np.unique(seen.images)
        return Survey(
            tags=tuple(found),
            left_out=tuple(sorted(left_out, key=lambda one: one.tag_id)),
            images=len(used),
            rms_px=float(np.sqrt((adjusted.residuals[fits] ** 2).sum(axis=2).mean())),
            corner_sd=adjusted.corner_sd,
            scale=factor,
            centres=bundle.centres[used] @ level.T * factor,
            weak=tuple(_weak(found)),
        )

    def _factor(self, bundle: Bundle, order: Sequence[int]) -> float:
        """By how much the map has to be stretched to fit the distances that were measured, in the least squares."""
        index = {self._tags[tag].tag_id: tag for tag in order}
        pairs = []
        for (one, other), measured in self._wanted.distances.items():
            missing = [code for code in (one, other) if code not in index]
            if missing:
                raise VisionError(f"--distance {one}:{other}: tag {missing[0]} is not in the map")
            pairs.append((measured, float(np.linalg.norm(bundle.places[index[one]] - bundle.places[index[other]]))))
        return sum(a * b for a, b in pairs) / sum(b * b for _, b in pairs) if pairs else 1.0


def _far(adjusted: Adjusted) -> Bools:
    """Which sightings show their tag elsewhere `(n,)`."""
    return np.asarray((adjusted.sizes > 2.0 * LARGE) & (adjusted.sizes * adjusted.corner_sd > FAR_PX))


def _displaced(far: Bools, images: Indices) -> tuple[TagFault, str]:
    """What a tag is that lies elsewhere in some of its images."""
    # Sightings that disagree with a move before each of them: far ones before and near ones after, or the reverse.
    before = np.concatenate([[0], np.cumsum(far)])
    after = np.cumsum(~far[::-1])[::-1]
    against = before + np.concatenate([after, [0]])
    wrong = np.minimum(against, len(far) - against)[1:-1]
    split = int(np.argmin(wrong)) + 1
    if wrong[split - 1] <= NOT_MOVED * len(far):
        words = (
            f"it was moved between images {images[split - 1] + 1} and {images[split] + 1} of those that were looked at"
        )
        return TagFault.MOVED, f"{words}: fix it and take the images again"
    share = f"{100.0 * far.mean():.0f} % of its {len(far)} images show it elsewhere"
    return TagFault.TWICE, f"{share}, now and then: two tags have this code, or it lies loose"


def free_covariances(adjusted: Adjusted, order: Sequence[int]) -> Array:
    """Covariances of tags `(k, 7, 7)` apart from where the map as a whole lies: of places in the best common frame.

    Those of the adjustment hold in the frame of the origin tag, whose own turn they carry to every other tag. Source:
    the S-transformation of W. Baarda, "S-Transformations and Criterion Matrices" (1973).
    """
    places = adjusted.bundle.places[list(order)]
    count = len(order)
    # A common shift v and turn w move a tag by v + w x p, and turn it by w.
    motions = np.zeros((count, 7, 6))
    motions[:, :3, :3] = np.eye(3)
    motions[:, :3, 3:] = [-skew(place) for place in places]
    motions[:, 3:6, 3:] = np.eye(3)
    common = motions.reshape(-1, 6)
    chosen = common * np.tile((1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0), count)[:, None]
    fitted = np.linalg.pinv(chosen.T @ common) @ chosen.T
    rows = (np.array(order)[:, None] * 7 + np.arange(7)).ravel()
    apart = np.eye(7 * count) - common @ fitted
    whole = apart @ adjusted.covariance[np.ix_(rows, rows)] @ apart.T
    return np.asarray(whole.reshape(count, 7, count, 7)[np.arange(count), :, np.arange(count)])


def _level(bundle: Bundle, order: Sequence[int]) -> Array:
    """Rotation `(3, 3)` from the first tag's frame to one whose z is the normal of the tags that lie as it does."""
    up = bundle.turns[order[0]][:, 2]
    flat = bundle.places[[tag for tag in order if bundle.turns[tag][:, 2] @ up > FLAT]]
    _, spread, axes = np.linalg.svd(flat - flat.mean(axis=0))
    if len(flat) < 3 or spread[1] < LINE * spread[0]:
        return np.eye(3)
    z = axes[2] * np.sign(axes[2] @ up)
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def _weak(tags: Sequence[Surveyed]) -> Iterator[tuple[int, str]]:
    """Tags that are weakly tied, the weakest first, and what to look at once more."""
    sds = np.array([np.linalg.norm(one.place_sd) for one in tags])
    places = np.array([one.tag.position for one in tags])
    for k in np.argsort(-sds):
        if sds[k] > WEAK * float(np.median(sds)) or tags[k].together_with < 2:
            nearest = np.argsort(np.linalg.norm(places - places[k], axis=1))[1:3]
            beside = " and ".join(str(tags[other].tag.tag_id) for other in nearest)
            yield tags[k].tag.tag_id, f"known to {1000.0 * sds[k]:.1f} mm: look at it once more together with {beside}"
