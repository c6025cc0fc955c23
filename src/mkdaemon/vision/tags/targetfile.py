"""Targets as text: our target file, and the tag maps of apriltag_ros, TagSLAM and WPILib.

Sources: the bundle of `tags.yaml` of apriltag_ros 3; `tagslam.yaml` of TagSLAM; the AprilTag field layout of WPILib.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, Final, Literal

import cv2

from mkdaemon.config.keys import toml_value
from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.vision.tags.tagmap import Tag, Target

Form = Literal["toml", "apriltag_ros", "tagslam", "wpilib"]
"""A format of `WRITERS`."""
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


WRITERS: Final[Mapping[Form, Callable[[Target], str]]] = {
    "toml": as_toml,
    "apriltag_ros": as_apriltag_ros,
    "tagslam": as_tagslam,
    "wpilib": as_wpilib,
}
"""Formats by their names."""


def _rounded(value: float) -> float:
    return round(float(value), DIGITS) + 0.0


def _listed(values: Any) -> list[float]:
    return [_rounded(value) for value in values]


def _numbers(values: Any) -> str:
    return str(_listed(values))
