"""First places of tags: how two tags lie to each other in most of the images that show both, from tag to tag."""

from __future__ import annotations

import heapq
import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.pose.pose import Pose, angle_between, solve
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.survey.bundle import Bundle, Sightings
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.tagmap import Tag

ASKED: Final = 25
"""Images that are asked how two tags lie to each other."""
SAME_TURN: Final = 0.15
"""Turns that differ by less agree [rad]; those of a tag and its mirrored pose differ by twice its tilt."""
SAME_PLACE: Final = 0.1
"""Places that differ by less agree, as a share of the distance from the camera."""
OPEN_PLACE: Final = 0.5
OPEN_TURN: Final = 0.5
"""By how much places [m] and turns [rad] by two ways may differ: each tie is known to centimetres and some degrees."""
FITS_PX: Final = 5.0
"""Residual up to which all tags of an image agree about where it was taken, before any adjustment [px]."""
ROUGHLY: Final = 0.5
"""A tag is about where it was expected within this share of its side: a small one shows the tilt badly."""

Seen = Sequence[tuple[int, Detection]]
"""What one image shows: index of the tag, and the tag as it was found."""


@dataclass(frozen=True, slots=True, eq=False)
class _Between:
    """How a second tag lies to a first one: first from second, the camera's distance, and the image that says so."""

    turn: Array
    place: Array
    distance: float
    image: int


@dataclass(frozen=True, slots=True, eq=False)
class _Tie:
    """How a tag lies to another one, and how many images agree on it."""

    agreed: int
    turn: Array
    place: Array


class Beginner:
    """Finds where tags are, and cameras were, well enough for an adjustment.

    Args:
        images: what each shows.
        tags: alone, each in its own frame.
        projection: of the camera.
    """

    def __init__(self, images: Sequence[Seen], tags: Sequence[Tag], projection: Projection) -> None:
        self._images, self._tags, self._projection = images, tags, projection
        self._solved: dict[tuple[int, int], list[Pose]] = {}
        together: dict[tuple[int, int], list[int]] = defaultdict(list)
        for image, seen in enumerate(images):
            for pair in itertools.combinations(sorted(tag for tag, _ in seen), 2):
                together[pair].append(image)
        self._ties: dict[int, dict[int, _Tie]] = defaultdict(dict)
        for (one, other), showing in together.items():
            # Those of ASKED images that lie as far apart as possible.
            asked = sorted({showing[k * len(showing) // ASKED] for k in range(ASKED)})
            choices = [each for image in asked for each in self._between(image, one, other)]
            if choices:
                tie = _most_agreed(choices)
                self._ties[one][other] = tie
                self._ties[other][one] = _Tie(tie.agreed, tie.turn.T, -tie.turn.T @ tie.place)

    def _between(self, image: int, one: int, other: int) -> Iterator[_Between]:
        """How one tag may lie to another, by an image that shows both; a flat tag has two poses."""
        for pose, second in itertools.product(self._alone(image, one), self._alone(image, other)):
            back, distance = pose.rotation.T, pose.range_m + second.range_m
            yield _Between(back @ second.rotation, back @ (second.position - pose.position), distance, image)

    def _alone(self, image: int, tag: int) -> list[Pose]:
        """Poses of a tag by itself."""
        if (image, tag) not in self._solved:
            found = dict(self._images[image])[tag]
            self._solved[image, tag] = solve([(self._tags[tag], found)], self._projection)
        return self._solved[image, tag]

    def neighbours(self, tag: int) -> set[int]:
        """Tags that some image shows together with this one."""
        return set(self._ties[tag])

    def contradictions(self, origin: int, without: Set[int]) -> int:
        """Images of ties that do not close: tags that lie elsewhere by another way from tag to tag."""
        turns, places, tied = self._reach(origin, without)
        count = 0
        for one, ties in self._ties.items():
            for other, tie in ties.items():
                if one < other and one in tied and other in tied:
                    apart = np.linalg.norm(turns[one] @ tie.place + places[one] - places[other])
                    turned = angle_between(turns[one] @ tie.turn, turns[other])
                    count += tie.agreed * bool(apart > OPEN_PLACE or turned > OPEN_TURN)
        return count

    def begin(self, origin: int, without: Set[int]) -> tuple[Bundle, Set[int], list[int]]:
        """Find first places in the frame of the origin.

        Args:
            origin: index of the tag whose frame the map's is.
            without: indices of tags that are not trusted.

        Returns:
            The places, of all tags and images; which tags, and which images, are tied to the origin. The places of
            others mean nothing.
        """
        turns, places, tied = self._reach(origin, without)
        found = ((image, self._eye(seen, tied, turns, places)) for image, seen in enumerate(self._images))
        eyes = {image: pose for image, pose in found if pose is not None}
        count = len(self._images)
        eye_turns, eye_places = np.tile(np.eye(3), (count, 1, 1)), np.tile((0.0, 0.0, 1.0), (count, 1))
        for image, pose in eyes.items():
            eye_turns[image], eye_places[image] = pose.rotation, pose.position
        sides = np.array([tag.size for tag in self._tags])
        return Bundle(turns, places, sides, eye_turns, eye_places), tied, list(eyes)

    def _reach(self, origin: int, without: Set[int]) -> tuple[Array, Array, set[int]]:
        """Places by the ties that most images agree on, the spanning tree of Prim: turns, places, tags."""
        turns, places = np.tile(np.eye(3), (len(self._tags), 1, 1)), np.zeros((len(self._tags), 3))
        reached: set[int] = set()
        waiting = [(0, origin, origin)]
        while waiting:
            _, tag, by = heapq.heappop(waiting)
            if tag in reached:
                continue
            if tag != by:
                tie = self._ties[by][tag]
                turns[tag], places[tag] = turns[by] @ tie.turn, turns[by] @ tie.place + places[by]
            reached.add(tag)
            for other, tie in self._ties[tag].items():
                if other not in reached and other not in without:
                    heapq.heappush(waiting, (-tie.agreed, other, tag))
        return turns, places, reached

    def _eye(self, seen: Seen, tied: Set[int], turns: Array, places: Array) -> Pose | None:
        """Where the camera of an image was, by most of the tags whose place is known."""
        placed = [
            (replace(self._tags[k], position=places[k], rotation=turns[k]), found) for k, found in seen if k in tied
        ]
        if not placed:
            return None
        best = next(iter(solve(placed, self._projection)), None)
        if len(placed) == 1 or (best is not None and best.rms_px < FITS_PX):
            return best
        # One of them is elsewhere: the pose by each alone, and by those that it explains.
        chosen: list[tuple[Tag, Detection]] = []
        for one in placed:
            for pose in solve([one], self._projection):
                explained = [each for each in placed if self._explains(pose, *each)]
                chosen = max(chosen, explained, key=len)
        return next(iter(solve(chosen, self._projection)), best) if chosen else best

    def _explains(self, pose: Pose, tag: Tag, found: Detection) -> bool:
        """Whether a tag is seen about where a pose has it."""
        pixels, visible = self._projection.project(tag.corners @ pose.rotation.T + pose.position)
        return bool(visible.all() and np.abs(pixels - found.corners).max() < ROUGHLY * found.side_px)


def _most_agreed(choices: Sequence[_Between]) -> _Tie:
    """The choice with which most images agree; a mirrored pose is another one in each image."""
    turns, places = np.array([one.turn for one in choices]), np.array([one.place for one in choices])
    images, far = np.array([one.image for one in choices]), np.array([one.distance for one in choices])
    # The trace of A B' is 1 + 2 cos of the angle between A and B.
    cosines = (np.einsum("nij,mij->nm", turns, turns) - 1.0) / 2.0
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    same = (cosines > np.cos(SAME_TURN)) & (apart < SAME_PLACE * far)
    counts = [len(set(images[row].tolist())) for row in same]
    best = int(np.argmax(counts))
    return _Tie(counts[best], choices[best].turn, choices[best].place)


def sightings(images: Sequence[Seen], kept: Set[int], of: Sequence[int]) -> Sightings:
    """The sightings of some tags in some images."""
    rows = [(image, tag, found.corners) for image in of for tag, found in images[image] if tag in kept]
    numbers = np.array([row[:2] for row in rows], dtype=np.int64).reshape(-1, 2)
    return Sightings(numbers[:, 0], numbers[:, 1], np.array([row[2] for row in rows]).reshape(-1, 4, 2))
