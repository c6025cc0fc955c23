"""Targets as text: ours is read back the same, others have the numbers and axes of their programs."""

from __future__ import annotations

import json
import re
from typing import get_args

import cv2
import numpy as np
import pytest

from mkdaemon.frames import rotation_from_euler, rotation_from_quaternion
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Place, Tag, Target
from mkdaemon.vision.tags.targetfile import FORMATS, Form, as_apriltag_ros, as_tagslam, as_toml, as_wpilib, load
from tests.places import CONFIGS

FAMILY = find_family("tag36h11")
LEANING = rotation_from_euler(0.2, -0.4, 2.5)
ROOM = Target(
    "room",
    "room",
    moving=False,
    level=True,
    tags=(
        Tag(FAMILY, 3, 0.16, np.zeros(3), np.eye(3)),
        Tag(FAMILY, 7, 0.1601234, np.array([1.25, -2.5, 0.3]), LEANING, np.full(3, 0.0012), np.full(3, 0.003)),
    ),
    places=(Place("pad", np.array([1.0, 2.0, 0.0]), rotation_from_euler(0.0, 0.0, 0.5)),),
)


def test_our_file_is_read_back_the_same(tmp_path):
    file = tmp_path / "room.toml"
    text = as_toml(ROOM, "Surveyed.\nLeft out: tag 9.", {7: "known to 0.4 mm"})
    file.write_text(text)
    [found] = load([file]).targets
    assert [(tag.tag_id, tag.size) for tag in found.tags] == [(7, 0.16012), (3, 0.16)]
    assert found.tags[0].position == pytest.approx([1.25, -2.5, 0.3], abs=1e-5)
    assert found.tags[0].rotation == pytest.approx(LEANING, abs=3e-5)
    assert found.tags[1].rotation == pytest.approx(np.eye(3))
    assert text.startswith("# Surveyed.\n# Left out: tag 9.\n")
    assert found.tags[0].place_sd == pytest.approx([0.0012] * 3)
    assert found.tags[0].turn_sd == pytest.approx([0.003] * 3, abs=1e-6)
    [place] = found.places
    assert (place.name, place.position.tolist()) == ("pad", [1.0, 2.0, 0.0])
    assert place.rotation == pytest.approx(ROOM.places[0].rotation, abs=1e-6)
    assert "# known to 0.4 mm\nfamily" in text


@pytest.mark.parametrize("file", sorted((CONFIGS / "targets").glob("*.toml")), ids=lambda file: file.stem)
def test_every_target_that_is_delivered_is_written_as_it_was_read(file, tmp_path):
    [before] = load([file]).targets
    again = tmp_path / "again.toml"
    again.write_text(as_toml(before))
    [after] = load([again]).targets
    assert [tag.code for tag in after.tags] == [tag.code for tag in before.tags]
    for one, other in zip(after.tags, before.tags, strict=True):
        assert one.corners == pytest.approx(other.corners, abs=1e-5)


def test_a_bundle_of_apriltag_ros_has_every_tag_on_a_line():
    lines = re.findall(
        r"\{id: (\d+), size: (\S+), x: (\S+), y: (\S+), z: (\S+), qw: (\S+), qx: (\S+), qy: (\S+), qz: (\S+)\}",
        as_apriltag_ros(ROOM),
    )
    numbers = np.array(lines, dtype=float)
    assert numbers[:, :2].tolist() == [[3, 0.16], [7, 0.16012]]
    assert numbers[1, 2:5].tolist() == [1.25, -2.5, 0.3]
    assert rotation_from_quaternion(tuple(numbers[1, 5:])) == pytest.approx(LEANING, abs=3e-5)


def test_tagslam_has_rotation_vectors():
    numbers = [float(value) for value in re.findall(r"[xyz]: (\S+)", as_tagslam(ROOM))]
    place, turn = np.array(numbers).reshape(2, 2, 3)[1]
    assert place.tolist() == [1.25, -2.5, 0.3]
    assert cv2.Rodrigues(turn)[0] == pytest.approx(LEANING, abs=3e-5)


def test_a_tag_of_wpilib_looks_along_its_x_axis():
    layout = json.loads(as_wpilib(ROOM))
    assert layout["field"] == {"length": 1.25, "width": 2.5}
    tags = {tag["ID"]: tag["pose"] for tag in layout["tags"]}
    assert list(tags[7]["translation"].values()) == [1.25, -2.5, 0.3]
    for tag in ROOM.tags:
        w, x, y, z = (tags[tag.tag_id]["rotation"]["quaternion"][name] for name in "WXYZ")
        out, right, up = rotation_from_quaternion((w, x, y, z)).T
        assert pytest.approx(tag.rotation, abs=3e-5) == np.array([right, up, out]).T


def test_every_format_that_is_offered_is_written():
    assert set(get_args(Form)) == FORMATS.keys()
