"""Targets as text: our target file, and the tag maps of apriltag_ros, TagSLAM and WPILib, read and written.

Sources: the bundle of `tags.yaml` of apriltag_ros 3; `tagslam.yaml` of TagSLAM; the AprilTag field layout of WPILib.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import cv2
import numpy as np
from pydantic import ValidationError

from mkdaemon.config.keys import toml_value
from mkdaemon.config.reader import load_section, read_file
from mkdaemon.config.vision import TagPlacement, TargetFile, TargetSection
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import parse_json, parse_yaml
from mkdaemon.frames import euler_from_rotation, quaternion_from_rotation, rotation_from_quaternion
from mkdaemon.vision.tags.tagmap import Tag, TagMap, Target, build

Form = Literal["toml", "apriltag_ros", "tagslam", "wpilib"]
"""A format of `FORMATS`."""
DIGITS: Final = 5
"""Of a length [m] and of a quaternion: a hundredth of a millimetre, and of a milliradian over a metre."""


def as_toml(target: Target, heading: str = "", notes: Mapping[int, str] | None = None) -> str:
    """Write a target file.

    Args:
        target: to write.
        heading: comment at its top, lines.
        notes: comments of tags, by their codes.
    """
    lines = [f"# {line}" for line in heading.splitlines()]
    lines += ["[[targets]]", f"name = {toml_value(target.name)}"]
    for tag in target.tags:
        lines += ["", "[[targets.tags]]"]
        note = (notes or {}).get(tag.tag_id)
        lines += [] if note is None else [f"# {note}"]
        lines += [f"family = {toml_value(tag.family.name)}", f"id = {tag.tag_id}", f"size = {_rounded(tag.size)!r}"]
        if tag.position.any():
            lines.append(f"position = {_numbers(tag.position)}")
        turn = quaternion_from_rotation(tag.rotation)
        if abs(turn[0]) < 1.0:
            lines.append(f"quaternion = {_numbers(turn)}")
        lines += [f"position_sd = {_numbers(tag.place_sd)}"] if tag.place_sd.any() else []
        lines += [f"turn_sd_deg = {_numbers(np.degrees(tag.turn_sd))}"] if tag.turn_sd.any() else []
    for place in target.places:
        yaw = euler_from_rotation(place.rotation)[2]
        lines += [
            "",
            "[[targets.places]]",
            f"name = {toml_value(place.name)}",
            f"position = {_numbers(place.position)}",
        ]
        lines += [f"yaw_deg = {_rounded(math.degrees(yaw))!r}"] if yaw else []
    return "\n".join(lines) + "\n"


def as_apriltag_ros(target: Target) -> str:
    """Write a bundle for `tags.yaml` of apriltag_ros."""
    lines = ["tag_bundles:", "  [", "    {", f"      name: '{target.name}',", "      layout:", "        ["]
    for tag in target.tags:
        (x, y, z), (qw, qx, qy, qz) = map(_listed, (tag.position, quaternion_from_rotation(tag.rotation)))
        place, turn = f"x: {x}, y: {y}, z: {z}", f"qw: {qw}, qx: {qx}, qy: {qy}, qz: {qz}"
        lines.append(f"          {{id: {tag.tag_id}, size: {_rounded(tag.size)}, {place}, {turn}}},")
    return "\n".join([*lines, "        ]", "    }", "  ]"]) + "\n"


def as_tagslam(target: Target) -> str:
    """Write a static body for `tagslam.yaml` of TagSLAM; its rotations are rotation vectors."""
    lines = ["bodies:", f" - {target.name}:", "     is_static: true", "     tags:"]
    for tag in target.tags:
        lines += [f"     - id: {tag.tag_id}", f"       size: {_rounded(tag.size)}", "       pose:"]
        for name, values in (("position", tag.position), ("rotation", cv2.Rodrigues(tag.rotation)[0].ravel())):
            x, y, z = _listed(values)
            lines += [f"         {name}:", f"           x: {x}", f"           y: {y}", f"           z: {z}"]
    return "\n".join(lines) + "\n"


def as_wpilib(target: Target) -> str:
    """Write a field layout of WPILib: the x axis of its tags is the normal of their prints."""
    places = [tag.position for tag in target.tags]
    length, width = (_rounded(max(place[k] for place in places) - min(place[k] for place in places)) for k in range(2))
    tags = [_of_field(tag) for tag in target.tags]
    return json.dumps({"tags": tags, "field": {"length": length, "width": width}}, indent=1) + "\n"


def _of_field(tag: Tag) -> dict[str, Any]:
    # WPILib's tag: x out of the print, y to the right of its reader (our x), z up (our y).
    normal_first = tag.rotation[:, [2, 0, 1]]
    w, x, y, z = _listed(quaternion_from_rotation(normal_first))
    place = dict(zip("xyz", _listed(tag.position), strict=True))
    return {
        "ID": tag.tag_id,
        "pose": {"translation": place, "rotation": {"quaternion": {"W": w, "X": x, "Y": y, "Z": z}}},
    }


@dataclass(frozen=True, slots=True)
class _Node:
    """A value of a document, and its place there: `tag_bundles[0].layout[3]`."""

    value: Any
    place: str
    known: TargetSection

    def get(self, key: str) -> _Node | None:
        """The value of a key; None where there is none."""
        if not isinstance(self.value, dict):
            raise self.wrong("a mapping of keys and values is needed")
        place = f"{self.place}.{key}" if self.place else key
        return None if self.value.get(key) is None else _Node(self.value[key], place, self.known)

    def __getitem__(self, key: str) -> _Node:
        found = self.get(key)
        if found is None:
            raise self.wrong(f"{key} is missing; add it")
        return found

    def each(self) -> Iterator[_Node]:
        """The values of a list."""
        if not isinstance(self.value, list):
            raise self.wrong("a list is needed")
        return (_Node(value, f"{self.place}[{k}]", self.known) for k, value in enumerate(self.value))

    def number(self, *, is_whole: bool = False) -> float:
        """A number."""
        value = self.value
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not is_number or (is_whole and value != int(value)):
            raise self.wrong(f"a {'whole ' if is_whole else ''}number is needed, not {str(value)[:40]!r}")
        return float(value)

    def numbers(self, keys: Sequence[str], *, default: Sequence[float] | None = None) -> tuple[float, ...]:
        """The numbers of some keys; without one the default."""
        if default is None:
            return tuple(self[key].number() for key in keys)
        found = zip(map(self.get, keys), default, strict=True)
        return tuple(value if node is None else node.number() for node, value in found)

    def size(self, default: _Node | None = None) -> float:
        """The side of a tag, else the default, else what is known of tags without one [m]."""
        node = self.get("size") or default
        if node is not None:
            return node.number()
        if self.known.size is None:
            raise self.wrong(f"size is missing; {_SIZE_REMEDY}")
        return self.known.size

    def tag(self, key: str, size: float, position: Sequence[float], quaternion: Sequence[float]) -> TagPlacement:
        """A tag, its code under a key."""
        code = int(self[key].number(is_whole=True))
        try:
            return TagPlacement.model_validate(
                {
                    "family": self.known.family,
                    "id": code,
                    "size": size,
                    "position": tuple(position),
                    "quaternion": tuple(quaternion),
                }
            )
        except ValidationError as error:
            wrong = error.errors()[0]
            keys = ".".join(str(part) for part in wrong["loc"])
            raise self.wrong(f"{keys or 'tag'}: {wrong['msg']}; correct it") from None

    def wrong(self, words: str) -> ConfigError:
        """An error about this value."""
        return ConfigError(f"{self.place}: {words}" if self.place else words)


_SIZE_REMEDY: Final = (
    "name this file in a target file, as `map` of [[targets]], beside the `size` of its tags in metres"
)


def _of_apriltag_ros(root: _Node) -> list[TargetSection]:
    return [
        _section(
            bundle["name"],
            [
                tag.tag(
                    "id",
                    tag.size(),
                    tag.numbers("xyz", default=(0.0, 0.0, 0.0)),
                    tag.numbers(("qw", "qx", "qy", "qz"), default=(1.0, 0.0, 0.0, 0.0)),
                )
                for tag in bundle["layout"].each()
            ],
        )
        for bundle in root["tag_bundles"].each()
    ]


def _of_tagslam(root: _Node) -> list[TargetSection]:
    found = []
    for item in root["bodies"].each():
        if not isinstance(item.value, dict) or len(item.value) != 1:
            raise item.wrong("a body is one name and what belongs to it")
        [name] = item.value
        body = item[name]
        if body.get("tags") is None:
            continue
        tags = []
        for tag in body["tags"].each():
            turn = np.array(tag["pose"]["rotation"].numbers("xyz"))
            quaternion = quaternion_from_rotation(np.asarray(cv2.Rodrigues(turn)[0], np.float64))
            place = tag["pose"]["position"].numbers("xyz")
            tags.append(tag.tag("id", tag.size(body.get("default_tag_size")), place, quaternion))
        static = body.get("is_static")
        moving = static is not None and static.value is False
        found.append(_section(_Node(name, item.place, item.known), tags, moving=moving))
    return found


def _of_wpilib(root: _Node) -> list[TargetSection]:
    tags = []
    for tag in root["tags"].each():
        pose = tag["pose"]
        q = pose["rotation"]["quaternion"].numbers("WXYZ")
        if sum(part * part for part in q) < SHORTEST:
            raise pose.wrong("the quaternion has no length; correct it")
        out_right_up = rotation_from_quaternion((q[0], q[1], q[2], q[3]))
        turn = quaternion_from_rotation(out_right_up[:, [1, 2, 0]])
        tags.append(tag.tag("ID", tag.size(), pose["translation"].numbers("xyz"), turn))
    return [_section(_Node("field", "", root.known), tags)]


def _section(name: _Node, tags: Sequence[TagPlacement], *, moving: bool = False) -> TargetSection:
    """A target; characters that no name of ours has become dashes."""
    called = re.sub(r"[^a-z0-9_-]", "-", str(name.value).lower()).lstrip("-_")
    if not called:
        raise name.wrong("a name of letters and digits is needed")
    return TargetSection(name=called, moving=moving, tags=tuple(tags))


SHORTEST: Final = 1e-6
"""Squared length of a quaternion that shows no rotation."""


class MapFormat(NamedTuple):
    """A format of target files.

    Attributes:
        write: a target as text.
        read: the targets of a document; None for our own format.
        key: at the top of every document of this format.
    """

    write: Callable[[Target], str]
    read: Callable[[_Node], list[TargetSection]] | None
    key: str


FORMATS: Final[Mapping[Form, MapFormat]] = {
    "toml": MapFormat(as_toml, None, "targets"),
    "apriltag_ros": MapFormat(as_apriltag_ros, _of_apriltag_ros, "tag_bundles"),
    "tagslam": MapFormat(as_tagslam, _of_tagslam, "bodies"),
    "wpilib": MapFormat(as_wpilib, _of_wpilib, "tags"),
}
"""Formats by their names."""
FOREIGN: Final = {".yaml": parse_yaml, ".yml": parse_yaml, ".json": parse_json}
"""Endings of files that are not ours."""


def load(paths: Iterable[Path]) -> TagMap:
    """Read target files, and tag maps of other programs.

    Args:
        paths: one or more files, TOML or of `FORMATS`; their targets are used together.

    Raises:
        ConfigError: a file cannot be read, or a key, size, family, id or overlap in it is wrong; names file, place
            and fix.
    """
    files = list(paths)
    names = ", ".join(map(str, files))
    try:
        sections = [section for path in files for section in _sections(path)]
    except ConfigError as error:
        msg = f"target file {error}"
        raise ConfigError(msg) from None
    if not sections:
        msg = f"no target in the target files '{names}': name one that has any, as configs/targets/nested.toml"
        raise ConfigError(msg)
    return build(sections, origin=f"target file {names}")


def _sections(path: Path) -> Iterator[TargetSection]:
    """The targets of a file, each with the tags of the map that it names."""
    if path.suffix.lower() in FOREIGN:
        yield from _foreign(path, TargetSection(name="map"))
        return
    for section in load_section(TargetFile, path).targets:
        if section.map is None:
            yield section
            continue
        found = _foreign(path.parent / section.map, section)
        if len(found) != 1:
            raise ConfigError(f"{path}: target '{section.name}': its map holds {len(found)} targets; keep one of them")
        yield section.model_copy(update={"tags": section.tags + found[0].tags})


def _foreign(path: Path, known: TargetSection) -> list[TargetSection]:
    """The targets of a map of another program; `known` has what the map may lack: family, and size of its tags."""
    text = read_file(path)
    try:
        root = _Node(FOREIGN.get(path.suffix.lower(), parse_yaml)(text), "", known)
        for form in FORMATS.values():
            if form.read is not None and root.get(form.key) is not None:
                return form.read(root)
        raise root.wrong(f"no tag map: {_known_keys()} is needed at its top")
    except (ConfigError, json.JSONDecodeError) as error:
        raise ConfigError(f"{path}: {error}") from None


def _known_keys() -> str:
    return " or ".join(f"{form.key} ({name})" for name, form in FORMATS.items() if form.read is not None)


def _rounded(value: float) -> float:
    return round(float(value), DIGITS) + 0.0


def _listed(values: Any) -> list[float]:
    return [_rounded(value) for value in values]


def _numbers(values: Any) -> str:
    return str(_listed(values))
