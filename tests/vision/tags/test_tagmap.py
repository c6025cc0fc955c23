"""Target files: what is placed where, and every mistake named with its place and fix."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from mkdaemon.config.vision import TargetFile
from mkdaemon.errors import ConfigError
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.tags.tagmap import covered_cells, single
from mkdaemon.vision.tags.targetfile import load
from mksim.scene.nested import NESTED
from tests.places import CONFIGS

ONE = """
[[targets]]
name = "pad"
[[targets.tags]]
id = 3
size = 0.3048
"""


def written(tmp_path, text, name="target.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_the_built_in_target_is_the_shipped_nested_one():
    file = TargetFile.model_validate(tomllib.loads((CONFIGS / "targets" / "nested.toml").read_text()))
    assert file.targets == (NESTED,)
    assert load([CONFIGS / "targets" / "nested.toml"]).whitelist == {"tag36h11": frozenset({1, 48})}


@pytest.fixture
def tag_of(tmp_path):
    """The tag of a file of one, with more lines about it."""
    return lambda more="": load([written(tmp_path, ONE + more)]).targets[0].tags[0]


def test_corners_are_those_of_the_upright_print(tag_of):
    h = 0.1524
    assert np.allclose(tag_of().corners, [[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])


def test_an_opencv_print_is_the_official_one_upside_down(tag_of):
    assert np.allclose(tag_of('print = "opencv"\n').corners, np.roll(tag_of().corners, 2, axis=0))


def test_rotations_in_degrees_and_as_quaternion_agree(tag_of):
    place = "position = [1, 2, 3]\n"
    rpy, quaternion = tag_of("rpy_deg = [0, 0, 90]\n" + place), tag_of("quaternion = [1, 0, 0, 1]\n" + place)
    assert np.allclose(rpy.corners, quaternion.corners)
    assert np.allclose(rpy.corners[0], [1 - 0.1524, 2 - 0.1524, 3])


def test_board_counts_along_rows_from_the_top_left(tmp_path):
    text = '[[targets]]\nname = "wall"\nlevel = false\n[targets.board]\nfirst_id = 10\nrows = 2\ncolumns = 3\n'
    target = load([written(tmp_path, text + "size = 0.1\nspacing = 0.05\n")]).targets[0]
    by_id = {tag.tag_id: tag.position for tag in target.tags}
    assert sorted(by_id) == [10, 11, 12, 13, 14, 15]
    assert np.allclose(by_id[10], [-0.15, 0.075, 0])
    assert np.allclose(by_id[15], [0.15, -0.075, 0])
    assert not target.level


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ONE.replace("0.3048", "304.8"), r"toml:6: targets\.0\.tags\.0\.size: must be at most 5 m, not 304\.8$"),
        (ONE.replace("0.3048", "0"), r"size: must be at least 0\.005 m, not 0$"),
        (ONE.replace("0.3048", '"12in"'), 'size: a number is needed, not "12in"$'),
        (ONE.replace("0.3048", "nan"), "size: a finite number is needed"),
        (ONE.replace("size", "sise"), 'sise: unknown key; did you mean "size"'),
        (ONE.replace("id = 3", "id = 600"), "0 to 586"),
        (ONE + 'family = "tag99h1"\n', "use one of tag36h11"),
        (ONE + "[[targets.tags]]\nid = 3\nsize = 0.1\n", "id 3 is in target 'pad' and already in 'pad'"),
        (ONE + "[[targets.tags]]\nid = 4\nsize = 0.29\n", "covers the border.*check the sizes"),
        (ONE + ONE.replace("id = 3", "id = 5"), "two targets or places are called 'pad'"),
        ('[[targets]]\nname = "pad"\n', "has no tags"),
        (ONE + "rpy_deg = [0, 0, 0]\nquaternion = [1, 0, 0, 0]\n", "not both"),
        ("[[targets]\n", "not valid TOML"),
        ("", "targets: must be given"),
        ("targets = []\n", "no target"),
    ],
)
def test_mistakes_are_one_line_with_place_and_fix(tmp_path, text, words):
    path = written(tmp_path, text)
    with pytest.raises(ConfigError, match=words) as caught:
        load([path])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("size", "tag_id", "words"),
    [(200.0, 7, "metres"), (400.0, 3, "not a tag size"), (0.3, -1, "tag -1 of tag36h11: id")],
)
def test_a_single_tag_that_nobody_prints_is_refused_with_what_is_wrong(size, tag_id, words):
    assert single(0.2, 7).tags[0].tag_id == 7
    with pytest.raises(ConfigError, match=words):
        single(size, tag_id)


PLACED = ONE + "position = [1, 2, 0]\nrpy_deg = [0, 0, 90]\n"
PLACE = "[[targets.places]]\nname = 'spot'\n"


def test_places_lie_on_a_tag_or_anywhere(tmp_path):
    text = PLACED + PLACE + "tag = 3\nyaw_deg = 10\n" + PLACE.replace("spot", "aside") + "position = [3, 0, 0.5]\n"
    spot, aside = load([written(tmp_path, text)]).targets[0].places
    assert (spot.name, aside.name) == ("spot", "aside")
    assert spot.position.tolist() == [1, 2, 0]
    assert np.allclose(spot.rotation, rotation_from_euler(0.0, 0.0, np.radians(100.0)))
    assert aside.position.tolist() == [3, 0, 0.5]
    assert np.allclose(aside.rotation, np.eye(3))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLACE + "tag = 4\n", "target 'pad': place 'spot': no tag of it has the code 4; give its position"),
        (PLACE + "tag = 3\nposition = [0, 0, 0]\n", "give tag or position, one of them"),
        (PLACE, "give tag or position, one of them"),
        (PLACE.replace("spot", "pad") + "tag = 3\n", "two targets or places are called 'pad'; rename one"),
        (PLACE + "tag = 3\n" + PLACE + "tag = 3\n", "two targets or places are called 'spot'; rename one"),
        (PLACE.replace("spot", "Spot 1") + "tag = 3\n", "targets.0.places.0.name"),
    ],
)
def test_a_wrong_place_is_one_line_with_a_fix(tmp_path, text, words):
    with pytest.raises(ConfigError, match=words):
        load([written(tmp_path, PLACED + text)])


def test_a_map_of_the_most_tags_of_a_family_loads_and_knows_what_covers_what(tmp_path):
    rows = "".join(f"[[targets.tags]]\nid = {k}\nsize = 0.2\nposition = [{k % 25}, {k // 25}, 0]\n" for k in range(500))
    small = "[[targets.tags]]\nid = 501\nsize = 0.02\nposition = [3, 0, 0]\n"
    tagmap = load([written(tmp_path, f"[[targets]]\nname = 'hall'\n{rows}{small}")])
    assert tagmap.targets[0].is_map
    hidden = {code for code, cells in covered_cells(tagmap).items() if cells.any()}
    assert hidden == {("tag36h11", 3)}
