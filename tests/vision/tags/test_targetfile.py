"""Targets as text: ours and those of other programs, read and written; each mistake named with a fix."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import parse_yaml
from mkdaemon.frames import rotation_from_euler, rotation_from_quaternion
from mkdaemon.vision.tags.tagfamily import find_family
from mkdaemon.vision.tags.tagmap import Place, Tag, Target
from mkdaemon.vision.tags.targetfile import FORMATS, as_toml, load
from tests.places import DATA

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


MAPS = DATA / "maps"
NAMES = {"toml": "map.toml", "apriltag_ros": "tags.yaml", "tagslam": "tagslam.yml", "wpilib": "field.json"}
FIELD = '[[targets]]\nname = "field"\nmap = "field.json"\nsize = 0.1651\n'


def test_a_bundle_of_apriltag_ros_is_a_target():
    [target] = load([MAPS / "tags.yaml"]).targets
    assert (target.name, [tag.tag_id for tag in target.tags]) == ("corridor", [3, 7, 8])
    assert [tag.size for tag in target.tags] == [0.16, 0.16, 0.08]
    assert target.tags[1].position.tolist() == [1.25, -0.5, 0.1]
    assert target.tags[1].rotation @ (1, 0, 0) == pytest.approx([0, 1, 0], abs=1e-4)
    assert target.tags[2].rotation == pytest.approx(np.eye(3))


def test_a_static_body_of_tagslam_is_a_target_and_one_without_tags_is_none():
    [target] = load([MAPS / "tagslam.yaml"]).targets
    assert (target.name, target.moving) == ("room", False)
    assert [(tag.tag_id, tag.size) for tag in target.tags] == [(5, 0.2), (4, 0.16)]
    assert target.tags[0].rotation @ (0, 0, 1) == pytest.approx([0, -1, 0], abs=1e-6)


def test_a_field_of_wpilib_needs_the_size_of_its_tags(tmp_path):
    with pytest.raises(ConfigError, match=r"field\.json: tags\[0\]: size is missing; name this file in a target file"):
        load([MAPS / "field.json"])
    (tmp_path / "field.json").write_text((MAPS / "field.json").read_text())
    (tmp_path / "field.toml").write_text(FIELD)
    [target] = load([tmp_path / "field.toml"]).targets
    near, far = target.tags
    assert (near.size, far.size) == (0.1651, 0.1651)
    assert near.rotation[:, 2].tolist() == pytest.approx([1, 0, 0]), "it looks along the x axis of the field"
    assert far.rotation[:, 2].tolist() == pytest.approx([-1, 0, 0])
    assert near.rotation[:, 1].tolist() == far.rotation[:, 1].tolist() == pytest.approx([0, 0, 1])


LENGTHS = st.floats(-20.0, 20.0)


@st.composite
def targets(draw):
    """Tags ten metres above each other, so that none hides another."""
    tags = []
    for code in draw(st.lists(st.integers(0, 586), min_size=1, max_size=6, unique=True)):
        turn = draw(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 0.1))
        place = np.array([draw(LENGTHS), draw(LENGTHS), 10.0 * len(tags)])
        tags.append(Tag(FAMILY, code, draw(st.floats(0.01, 4.9)), place, rotation_from_quaternion(turn)))
    return Target("room", "room", moving=False, level=True, tags=tuple(tags))


@pytest.mark.parametrize("form", FORMATS)
@settings(max_examples=20, deadline=None)
@given(target=targets())
def test_what_is_written_is_read_back(form, target, tmp_path_factory):
    file = tmp_path_factory.mktemp(form) / NAMES[form]
    file.write_text(FORMATS[form].write(target))
    sized = form == "wpilib"
    if sized:
        file.with_suffix(".toml").write_text(FIELD)
        file = file.with_suffix(".toml")
    [found] = load([file]).targets
    written = {tag.tag_id: tag for tag in target.tags}
    assert {tag.tag_id for tag in found.tags} == written.keys()
    for tag in found.tags:
        before = written[tag.tag_id]
        assert tag.size == pytest.approx(0.1651 if sized else before.size, abs=1e-5)
        assert tag.position == pytest.approx(before.position, abs=1e-5)
        assert tag.rotation == pytest.approx(before.rotation, abs=5e-5)


def changed(name, before, after):
    text = (MAPS / name).read_text()
    assert before in text
    return text.replace(before, after)


@pytest.mark.parametrize(
    ("name", "before", "after", "words"),
    [
        ("tags.yaml", "size: 0.16, x: 1", "x: 1", r"tag_bundles\[0\]\.layout\[1\]: size is missing; name this file"),
        ("tags.yaml", "size: 0.08", "size: 80", r"layout\[2\]: size: Input should be less than or equal to 5; correct"),
        ("tags.yaml", "id: 8,", "id: 8.5,", r"layout\[2\]\.id: a whole number is needed, not '8\.5'"),
        ("tags.yaml", "id: 8,", "id: 600,", r"target 'corridor': .*0 to 586"),
        ("tags.yaml", "x: 0.40", "x: far", r"layout\[2\]\.x: a number is needed, not 'far'"),
        ("tags.yaml", "qw: 1.0000", "qw: 0", r"layout\[0\]: .*no length"),
        ("tags.yaml", "x: 0.40", "x: 0.40, id: 9", "line 14: found duplicate key .id."),
        ("tags.yaml", "'Corridor'", "'--'", r"tag_bundles\[0\]\.name: a name of letters and digits"),
        ("tags.yaml", "tag_bundles", "bundles", r"no tag map: tag_bundles \(apriltag_ros\) or bodies \(tagslam\) or"),
        ("tags.yaml", "{id: 8, ", "{id 8, ", r"layout\[2\]: id is missing; add it"),
        ("tags.yaml", "tag_bundles:", "tag_bundles: !!python/none", "line 6: could not determine a constructor"),
        ("tagslam.yaml", "         rotation: {x", "         turn: {x", r"tags\[1\]\.pose: rotation is missing; add it"),
        ("field.json", '"W": 1.0', '"W": 0.0', r"tags\[0\]\.pose: the quaternion has no length"),
        ("field.json", '"ID": 2', '"ID": true', r"tags\[1\]\.ID: a whole number is needed, not 'True'"),
        ("field.json", '"ID": 2', '"ID": 1', "already in 'field'; every tag may exist once"),
        ("field.json", '"tags": [', '"tags": ', "Expecting|Extra data"),
    ],
)
def test_a_mistake_names_file_place_and_fix(tmp_path, name, before, after, words):
    (tmp_path / name).write_text(changed(name, before, after))
    file = tmp_path / name
    if name == "field.json":
        file = tmp_path / "field.toml"
        file.write_text(FIELD)
    with pytest.raises(ConfigError, match=words) as caught:
        load([file])
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_map_with_two_targets_is_not_the_map_of_one(tmp_path):
    bodies = "".join(
        f" - {name}:\n     tags:\n     - {{id: {code}, size: 0.1, pose: {{position: &, rotation: &}}}}\n"
        for code, name in enumerate(("a", "b"))
    )
    (tmp_path / "two.yaml").write_text("bodies:\n" + bodies.replace("&", "{x: 0, y: 0, z: 0}"))
    assert [target.name for target in load([tmp_path / "two.yaml"]).targets] == ["a", "b"]
    (tmp_path / "two.toml").write_text(FIELD.replace("field.json", "two.yaml"))
    with pytest.raises(ConfigError, match="target 'field': its map holds 2 targets; keep one of them"):
        load([tmp_path / "two.toml"])


def test_names_that_stand_for_much_cost_nothing():
    """Ten lists of ten names each, nine times: a thousand million values by the words of the file."""
    rows = ["a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8, 9, 0]"]
    rows += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 9)]
    assert parse_yaml("\n".join(rows))["a8"][0][0][0][0][0][0][0][0][9] == 0
    with pytest.raises(ConfigError, match="nests deeper"):
        parse_yaml("a: &a [*a]")
    with pytest.raises(ConfigError, match="nests deeper"):
        parse_yaml("[" * 700)
