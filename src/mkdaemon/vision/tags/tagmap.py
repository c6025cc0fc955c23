"""Targets: which tags exist, how large they are and how they sit in their target's frame."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from pydantic import ValidationError

from mkdaemon.config.vision import BoardSection, PlaceSection, TagPlacement, TargetSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.frames import rotation_from_euler, rotation_from_quaternion
from mkdaemon.vision.arrays import Array, Bools, Grey
from mkdaemon.vision.tags.tagfamily import QUIET_ZONE_CELLS, TagFamily, cells, find_family, middles, size_words

ONE_PLANE = 1 - 1e-9
"""Cosine between the normals of tags of one plane."""
SAME_HEIGHT_M = 1e-6
"""Distance between the planes of tags of one plane [m]."""
ROUNDING_M = 1e-9
"""Lengths from decimal numbers may differ by this [m]."""
COVER_CELLS = 0.3
"""How far beyond its paper a tag hides what lies below [cells]: its rim casts a shadow and blurs."""
TOGETHER = 8
"""Tags that are always measured together: `prints.MOST`."""
DENSE = 0.5
"""Share of a target's extent that its prints cover, from which they are measured together, however many they are."""
UPSIDE_DOWN = (-1.0, -1.0, 1.0)
"""Signs of the axes of a tag that is turned by half on its paper."""


@dataclass(frozen=True, eq=False)
class Tag:
    """One tag in its target.

    Attributes:
        family: the family of its code.
        tag_id: the code.
        size: side of the black square, of the white one inside the black ring for inverted families [m].
        position: centre of the tag `(3,)` [m; target].
        rotation: target from tag `(3, 3)`, tag axes as in `tagfamily`.
        place_sd: deviation of the position `(3,)` [m; target].
        turn_sd: deviation of the rotation about each axis `(3,)` [rad; target].
    """

    family: TagFamily
    tag_id: int
    size: float
    position: Array
    rotation: Array
    place_sd: Array = field(default_factory=lambda: np.zeros(3))
    turn_sd: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def code(self) -> tuple[str, int]:
        """Family and id."""
        return self.family.name, self.tag_id

    @property
    def module(self) -> float:
        """Side of one cell [m]."""
        return self.size / self.family.size_cells

    @property
    def paper(self) -> float:
        """Side of the white square a print needs, quiet zone included [m]."""
        return (self.family.black_cells + 2 * QUIET_ZONE_CELLS) * self.module

    @property
    def bitmap(self) -> Grey:
        """Cells of everything black `(n, n)` uint8, row 0 at the tag's +y."""
        return cells(*self.code)

    def place(self, points_tag: Array) -> Array:
        """Carry `(n, 2)` points of the tag plane into the target frame `(n, 3)` [m]."""
        return points_tag @ self.rotation[:, :2].T + self.position

    def local(self, points: Array) -> Array:
        """Points `(..., 3)` of the target frame in that of the tag `(..., 3)` [m]."""
        return np.asarray((points - self.position) @ self.rotation)

    @cached_property
    def corners(self) -> Array:
        """Corners TL, TR, BR, BL of the square that is the tag's size `(4, 3)` [m; target]."""
        return self._square(self.size)

    @cached_property
    def outline(self) -> Array:
        """Corners of the square that holds everything black `(4, 3)` [m; target]."""
        return self._square(self.module * self.family.black_cells)

    def _square(self, side: float) -> Array:
        half = side / 2
        return self.place(np.array([[-half, half], [half, half], [half, -half], [-half, -half]]))


@dataclass(frozen=True, eq=False)
class Place:
    """A named place in a target.

    Attributes:
        name: name in results.
        position: its origin `(3,)` [m; target].
        rotation: target from place `(3, 3)`.
    """

    name: str
    position: Array
    rotation: Array

    @classmethod
    def on(cls, tag: Tag, name: str, turned: float = 0.0) -> Place:
        """In the middle of a tag, level as the target, its x axis that of the tag, turned by an angle [rad]."""
        x, y, _ = tag.rotation[:, 0].tolist()
        return cls(name, tag.position, rotation_from_euler(0.0, 0.0, math.atan2(y, x) + turned))


@dataclass(frozen=True, eq=False)
class Target:
    """A rigid body with tags on it, largest first: a later tag lies on top of an earlier one.

    Attributes:
        name: name in results.
        frame: name in `tf`.
        moving: the target moves in the world.
        level: its xy plane is horizontal at rest.
        tags: at least one.
        bend: deviation of how far its print bends, as a share of the side (`prints.Sheet`).
        places: that have a name.
    """

    name: str
    frame: str
    moving: bool
    level: bool
    tags: tuple[Tag, ...]
    bend: float = 0.003
    places: tuple[Place, ...] = ()

    @cached_property
    def is_map(self) -> bool:
        """Whether it is a map: more than `TOGETHER` tags, whose prints cover less than `DENSE` of its extent."""
        extent = np.sort(np.ptp([tag.position for tag in self.tags], axis=0) + self.tags[0].paper)
        covers = sum(tag.paper**2 for tag in self.tags) / float(extent[1] * extent[2])
        return len(self.tags) > TOGETHER and covers < DENSE

    def seen_from(self, place: Place) -> Target:
        """The same tags in the frame of a place, under its name."""
        back = place.rotation.T
        tags = (
            replace(tag, position=back @ (tag.position - place.position), rotation=back @ tag.rotation)
            for tag in self.tags
        )
        return replace(self, name=place.name, frame=place.name, tags=tuple(tags), places=())

    @cached_property
    def is_planar(self) -> bool:
        """Whether all tags lie in one plane with equal normals."""
        first = self.tags[0]
        return all(
            float(tag.rotation[:, 2] @ first.rotation[:, 2]) > ONE_PLANE
            and abs(float(first.local(tag.position)[2])) < SAME_HEIGHT_M
            for tag in self.tags
        )


@dataclass(frozen=True, eq=False)
class TagMap:
    """All targets of one camera."""

    targets: tuple[Target, ...]

    @cached_property
    def owners(self) -> dict[tuple[str, int], tuple[Target, Tag]]:
        """Target and tag by (family, id)."""
        return {tag.code: (target, tag) for target in self.targets for tag in target.tags}

    @cached_property
    def whitelist(self) -> dict[str, frozenset[int]]:
        """Ids that may be reported, by family."""
        names = {family for family, _ in self.owners}
        return {name: frozenset(i for family, i in self.owners if family == name) for name in sorted(names)}


def covered(points: Array, tag: Tag) -> Bools:
    """Which points `(n, 3)` [m; target] lie under the paper of a tag in the same plane."""
    local, half = np.abs(tag.local(points)), tag.paper / 2 + COVER_CELLS * tag.module
    return np.asarray((local[:, 2] < tag.module) & (local[:, :2].max(axis=1) <= half))


def covered_cells(tagmap: TagMap) -> dict[tuple[str, int], Bools]:
    """Cells `(n, n)` of each tag, by family and id, whose middles lie under the paper of a later one of its target."""
    found: dict[tuple[str, int], Bools] = {}
    centres = {target.name: np.array([tag.position for tag in target.tags]) for target in tagmap.targets}
    papers = {target.name: np.array([tag.paper for tag in target.tags]) for target in tagmap.targets}
    for code, (target, tag) in tagmap.owners.items():
        n = tag.family.black_cells
        points = tag.place((middles(n) - n / 2) * (tag.module, -tag.module))
        reach = np.linalg.norm(centres[target.name] - tag.position, axis=1) < papers[target.name] + tag.paper
        after = target.tags.index(tag)
        later = [target.tags[k] for k in np.flatnonzero(reach).tolist() if k > after]
        found[code] = np.any([np.zeros(n * n), *(covered(points, one) for one in later)], axis=0).reshape(n, n)
    return found


def single(size: float, tag_id: int, *, family: str = "tag36h11") -> Target:
    """Make a target of one tag with the target's axes.

    Raises:
        ConfigError: unknown family or id, or an implausible size.
    """
    try:
        section = TargetSection(name="tag", tags=(TagPlacement(family=family, id=tag_id, size=size),))
    except ValidationError as error:
        wrong = error.errors()[0]
        msg = f"{size!r} is not a tag size; give the side of the black square in metres, 0.005 to 5 (12 inch = 0.3048)"
        if wrong["loc"][-1] != "size":
            msg = f"tag {tag_id} of {family}: {wrong['loc'][-1]}: {wrong['msg']}"
        raise ConfigError(msg) from None
    return build([section], origin="tag").targets[0]


def build(sections: Iterable[TargetSection], *, origin: str) -> TagMap:
    """Check sections against each other and place their tags.

    Raises:
        ConfigError: a size, family, id or overlap is wrong; `origin` starts the message.
    """
    tagmap = TagMap(())
    for section in sections:
        try:
            tagmap = TagMap((*tagmap.targets, _placed(section, tagmap)))
        except VisionError as error:
            msg = f"{origin}: target '{section.name}': {error}"
            raise ConfigError(msg) from None
    return tagmap


def _placed(section: TargetSection, others: TagMap) -> Target:
    """The target of a section, beside others; `VisionError` says what is wrong with it."""
    names = Counter((section.name, *(place.name for place in section.places)))
    for other in others.targets:
        names.update((other.name, *(place.name for place in other.places)))
    for name, count in names.items():
        if count > 1:
            raise VisionError(f"two targets or places are called '{name}'; rename one")
    placements = section.tags + (_grid(section.board) if section.board is not None else ())
    if not placements:
        msg = "it has no tags; add [[targets.tags]] or [targets.board]"
        raise VisionError(msg)
    owners = {code: owner.name for code, (owner, _) in others.owners.items()}
    for one in placements:
        if (code := (one.family, one.id)) in owners:
            tag = f"{one.family} id {one.id} is in target '{section.name}' and already in '{owners[code]}'"
            msg = f"{tag}; every tag may exist once, give one of them another id"
            raise VisionError(msg)
        owners[code] = section.name
    tags = tuple(sorted(map(_place, placements), key=lambda tag: -tag.size))
    _check_overlaps(tags)
    frame = section.frame or section.name
    places = tuple(_named_place(place, tags) for place in section.places)
    return Target(section.name, frame, section.moving, section.level, tags, section.bend, places)


def _named_place(section: PlaceSection, tags: Sequence[Tag]) -> Place:
    yaw = math.radians(section.yaw_deg)
    if section.position is not None:
        return Place(section.name, np.array(section.position), rotation_from_euler(0.0, 0.0, yaw))
    found = [tag for tag in tags if tag.tag_id == section.tag]
    if len(found) != 1:
        has = "no tag of it has" if not found else f"{len(found)} tags of it have"
        raise VisionError(f"place '{section.name}': {has} the code {section.tag}; give its position")
    return Place.on(found[0], section.name, yaw)


def _grid(board: BoardSection) -> tuple[TagPlacement, ...]:
    pitch = board.size + board.spacing
    left, top = -(board.columns - 1) / 2 * pitch, (board.rows - 1) / 2 * pitch
    ys, xs = (top - row * pitch for row in range(board.rows)), (left + k * pitch for k in range(board.columns))
    return tuple(
        TagPlacement(family=board.family, id=board.first_id + k, size=board.size, position=(x, y, 0.0))
        for k, (y, x) in enumerate(itertools.product(ys, xs))
    )


def _place(placement: TagPlacement) -> Tag:
    family = find_family(placement.family)
    cells(family.name, placement.id)
    if placement.print == "opencv" and family.is_inverted:
        msg = f'OpenCV cannot draw {family.name}; remove print = "opencv"'
        raise VisionError(msg)
    if placement.quaternion is not None:
        rotation = rotation_from_quaternion(placement.quaternion)
    else:
        rotation = rotation_from_euler(*(math.radians(angle) for angle in placement.rpy_deg or (0.0, 0.0, 0.0)))
    if placement.print == "opencv":
        rotation = rotation * UPSIDE_DOWN
    sds = np.array(placement.position_sd), np.radians(placement.turn_sd_deg)
    return Tag(family, placement.id, placement.size, np.array(placement.position), rotation, *sds)


def _check_overlaps(tags: Sequence[Tag]) -> None:
    """Refuse tags that hide the border of a larger one."""
    outlines = np.array([tag.outline for tag in tags])
    quiet = QUIET_ZONE_CELLS * np.array([tag.module for tag in tags])
    for k, outer in enumerate(tags[:-1], 1):
        half = outer.module * outer.family.black_cells / 2
        local = outer.local(outlines[k:])
        low, high = local[..., :2].min(axis=1), local[..., :2].max(axis=1)
        apart = (np.abs(local[..., 2]).max(axis=1) > outer.module) | ((low >= half) | (high <= -half)).any(axis=1)
        # An inner tag with its quiet zone has to stay inside the coded cells, or the outer border is broken;
        # inverted families correct too few bits to lose any.
        room = outer.module * outer.family.hole_cells / 2 if outer.family.is_inverted else half - outer.module
        farthest = np.maximum(-low, high).max(axis=1) + quiet[k:]
        for i in np.flatnonzero(~apart & (farthest > room + ROUNDING_M)):
            inner = tags[k + int(i)]
            msg = (
                f"tag {inner.tag_id} ({inner.size:g} m) covers the border of tag {outer.tag_id} ({outer.size:g} m);"
                f" check the sizes ({size_words(outer.family)} in metres) and positions"
            )
            raise VisionError(msg)
