"""A camera against a reference: each injected fault is found with its size, from a recording to its chapter."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.view.report.alignment import TagView, rotations_by
from mkdaemon.view.report.baseline import NO_TAG, OUT_OF_SIGHT, Baseline, Images, NoAnswer, compare
from mkdaemon.view.report.make import report_of
from mkdaemon.view.report.page import render
from tests.view.report.compared import Wrong, add_poses, only, recorded, tracks, truth, without
from tests.view.report.known import Tape

VIEW = TagView(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.array([0.2]), np.zeros(3), np.eye(3))
LOOKING_DOWN = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
QUIET = 0.2
"""What is not injected stays below this, shown in cm, deg or %; in ms ten times as much."""


def images_of(track):
    return Images(track.times, [""] * len(track.times), np.ones(len(track.times)))


def against(camera, reference, view=VIEW, images=None):
    found = compare(camera, reference, view, images or images_of(camera))
    assert isinstance(found, Baseline), found
    return found


def shown(found):
    """Offsets in the units that they are shown in."""
    return {one.quantity.name: one.quantity.factor * one.value for one in found.offsets}


@pytest.mark.parametrize(
    ("wrong", "injected"),
    [
        (Wrong(), {}),
        (Wrong(scale=1.02, lag=0.04), {"position scale, less 1": 2.0}),
        (Wrong(place=(0.03, -0.04, 0.02)), {"mounting, forward": 3.0, "mounting, left": -4.0, "mounting, up": 2.0}),
        (
            Wrong(turn=(0.02, -0.03, 0.0)),
            {"mounting, roll": math.degrees(0.02), "mounting, pitch": -math.degrees(0.03)},
        ),
        (Wrong(frame=(3.0, -2.0, 0.1), heading=2.0), {"frame, x": 300.0, "frame, y": -200.0, "frame, z": 10.0}),
        (Wrong(scale=0.97, place=(0.0, 0.03, 0.0), lag=-0.3), {"position scale, less 1": -3.0, "mounting, left": 3.0}),
    ],
    ids=str,
)
def test_what_is_injected_is_found_with_its_size(wrong, injected):
    found = against(*tracks(wrong))
    values = shown(found)
    for one in found.offsets:
        name, expected = one.quantity.name, injected.get(one.quantity.name, 0.0)
        if name == "frame, turn about z":
            expected = math.degrees(wrong.heading)
        if one.quantity.unit == "ms":  # the lag of the camera's stamps
            expected = 1000.0 * wrong.lag
        tolerance = 10.0 * QUIET if one.quantity.unit == "ms" else QUIET
        assert values[name] == pytest.approx(expected, abs=tolerance), name
        assert one.is_known, name
        assert one.is_found == (abs(expected) > one.quantity.finds * one.quantity.factor), name


def test_detection_counts_only_images_with_the_target_in_view():
    camera, reference = tracks()
    lens = np.array([425.0, 425.0, 319.5, 239.5, 640.0, 480.0])
    view = replace(VIEW, flu_from_cam=LOOKING_DOWN, lens=lens)
    poses = [truth(at) for at in camera.times]
    away = np.array([-place @ turn @ LOOKING_DOWN for place, turn in poses])
    u = np.abs(425.0 * away[:, 0] / away[:, 2]) + 85.0 / away[:, 2] < 319.5
    v = np.abs(425.0 * away[:, 1] / away[:, 2]) + 85.0 / away[:, 2] < 239.5
    inside = u & v
    assert 50 < (~inside).sum() < 700
    # Of what is in view, every fourth image has no pose; nothing out of view has one.
    outcomes = [("" if k % 4 else "bits") if seen else NO_TAG for k, seen in enumerate(inside)]
    posed = np.array([not one for one in outcomes])
    found = against(only(camera, posed), reference, view, Images(camera.times, outcomes, np.ones(len(outcomes))))
    images = sum(one.images for one in found.distances)
    assert images == pytest.approx(inside.sum(), rel=0.02)
    assert sum(one.posed for one in found.distances) / images == pytest.approx(0.75, abs=0.02)
    assert {one.reason for one in found.drop_outs if one.length > 0.3} == {OUT_OF_SIGHT}


def test_a_fisheye_sees_what_a_pinhole_does_not_and_of_many_tags_the_nearest_is_looked_at():
    lens = np.array([200.0, 200.0, 320.0, 240.0, 640.0, 480.0])
    place = np.array([[-2.0, 0.0, -0.5], [0.0, 0.0, 1.0]])
    for is_fisheye in (False, True):
        view = replace(VIEW, radii=np.array([0.01]), lens=lens, is_fisheye=is_fisheye)
        assert view.look(place, np.array([np.eye(3)] * 2))[3].tolist() == [is_fisheye, False]
    view = replace(VIEW, centres=np.array([[0.0, 0, 0], [4.0, 0, 1.0]]), normals=np.array([[0, 0, 1.0], [-1.0, 0, 0]]))
    view = replace(view, radii=np.array([0.2, 0.2]))
    away, tags, cosine, _ = view.look(np.array([[3.0, 0.0, 1.0]]), np.eye(3)[None])
    assert (away[0].tolist(), tags[0].tolist(), cosine[0]) == ([-1.0, 0.0, 0.0], [4.0, 0.0, 1.0], 1.0)


def still(track):
    place, turn = truth(3.0)
    noise = np.random.default_rng(3).normal(0.0, 0.002, track.positions.shape)
    turns = np.repeat(turn[None], len(track.times), axis=0)
    return replace(track, positions=place + noise, rotations=turns @ rotations_by(noise))


def test_a_reference_that_stands_still_tells_neither_lag_nor_scale_nor_mounting():
    camera, reference = tracks(seconds=10.0)
    found = against(still(camera), still(reference))
    assert found.is_still
    unknown = {one.quantity.group.name for one in found.offsets if not one.is_known}
    assert unknown >= {"lag", "position scale", "mounting"}
    assert not any(one.is_found for one in found.offsets)
    assert np.median(found.errors.across) < 0.01


CAMERA, REFERENCE = tracks(seconds=10.0)


@pytest.mark.parametrize(
    ("camera", "reference", "told"),
    [
        (without(CAMERA, (1.0, 20.0)), REFERENCE, "The camera has 20 poses, and 50 are needed"),
        (CAMERA, without(REFERENCE, (0.5, 20.0)), "The reference has 17 poses, and 50 are needed"),
        (replace(CAMERA, times=CAMERA.times + 50.0), REFERENCE, "do not overlap in time: record both at once"),
        (without(CAMERA, (2.0, 8.0)), without(REFERENCE, (0.0, 1.9), (8.1, 11.0)), "fall between two of the reference"),
        (without(CAMERA, (0.0, 20.0)), REFERENCE, "The camera has 0 poses"),
    ],
)
def test_what_cannot_be_answered_is_said_with_a_remedy(camera, reference, told):
    found = compare(camera, reference, VIEW, images_of(camera))
    assert isinstance(found, NoAnswer)
    assert told in found.reason
    assert "record" in found.reason


@pytest.fixture(scope="module")
def scaled(tmp_path_factory):
    """The report of a camera whose distances are 2 % too long, and its stamps late."""
    path = recorded(tmp_path_factory.mktemp("against") / "scaled.mcap", Wrong(scale=1.02, lag=0.04))
    return report_of(path, None, against="mocap")


def rows_of(chapter, title):
    (table,) = (one for one in chapter.sheets if one.title.startswith(title))
    return {row[0]: dict(zip(table.head, row, strict=True)) for row in table.rows}


def test_a_recording_has_its_chapter_where_it_is_asked_for(scaled):
    (chapter,) = scaled.chapters
    assert (chapter.camera, chapter.reference, chapter.is_answered) == ("down", "mocap", True)
    told = " ".join(chapter.sentences)
    found = {name: float(size) for name, size in re.findall(r"(scale, less 1|stamps) ([+-][\d.]+) ±", told)}
    assert found == pytest.approx({"scale, less 1": 2.0, "stamps": 40.0}, rel=0.03)
    assert "measure the print" in told
    scales = [row["scale"] for row in rows_of(chapter, "By distance").values() if row["scale"] != "-"]
    assert [float(scale) for scale in scales] == pytest.approx([1.02] * len(scales), abs=0.003)
    rates = rows_of(chapter, "Rates")
    assert rates["usual rate (Hz)"] == {"": "usual rate (Hz)", "down": "20.0", "mocap": "33.3"}
    assert (rates["drop-outs"]["down"], rates["drop-outs"]["mocap"]) == ("2", "0")
    reasons = rows_of(chapter, "Drop-outs of down")
    assert set(reasons) == {"ambiguous", "no tag found"}
    assert float(reasons["ambiguous"]["longest (s)"]) == pytest.approx(1.5, abs=0.06)
    # 600 images, of which 29 or 30 were refused; of 11 or 12 without a value three were dropped before the eyes.
    seen = rows_of(chapter, "By viewing angle").values()
    images = sum(int(row["images"]) for row in seen)
    assert images == pytest.approx(597, abs=3)


def test_reports_that_no_daemon_published_are_a_reference_in_a_frame_of_their_own(tmp_path):
    path = recorded(tmp_path / "foreign.mcap", Wrong(frame=(2.0, 1.0, 0.0), heading=1.0), as_reports=True)
    (chapter,) = report_of(path, None, against="mocap").chapters
    assert chapter.is_answered
    assert any("its own frame" in one for one in chapter.sentences)
    errors = rows_of(chapter, "Errors")
    assert {row["as recorded"] for row in errors.values()} == {"-"}
    assert float(errors["across it (cm)"]["without offsets and lag"].split(" / ")[0]) < 0.5
    assert rows_of(chapter, "Constant")["frame, x (cm)"]["estimate ± sd"].startswith(("+200", "+199"))


def test_two_cameras_are_compared_and_each_other_source(tmp_path):
    tape = Tape()
    camera, reference = tracks(seconds=30.0)
    add_poses(tape, "down", camera)
    add_poses(tape, "front", reference)
    add_poses(tape, "gps", reference, "home")
    chapters = report_of(tape.write(tmp_path / "two.mcap"), None, against="front").chapters
    assert [(one.camera, one.is_answered) for one in chapters] == [("down", True), ("gps", True)]
    assert any("no lens in vision/down/setup" in one for one in chapters[0].sentences)


def test_a_page_shows_it(scaled):
    page = render(scaled, "library").decode()
    assert "<h2>down against mocap</h2>" in page
    figures = json.loads(page.partition('id="figures">')[2].partition("</script>")[0])
    alone = {figure["name"]: figure for figure in figures if figure["alone"]}
    assert len(alone) == 6
    assert 'id="plots-note"' in page  # the script of the page begins with it, also where nothing is plotted over time
    for name, figure in alone.items():
        assert f'id="plot-{name}"' in page
        assert figure["data"][0]["x"]
    scale = next(figure for name, figure in alone.items() if "scale" in name)
    assert np.median(scale["data"][0]["y"]) == pytest.approx(1.02, abs=0.002)


def test_a_recording_of_a_reference_alone_asks_for_a_camera(tmp_path):
    tape = Tape()
    add_poses(tape, "mocap", tracks(seconds=5.0)[1])
    with pytest.raises(ConfigError, match="only mocap has poses; record with a camera"):
        report_of(tape.write(tmp_path / "alone.mcap"), None, against="mocap")
