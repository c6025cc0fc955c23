"""From a recording to the chapter of its report, and to the tables on the terminal."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from mkdaemon.errors import ConfigError
from mkdaemon.view.report.make import report_of
from mkdaemon.view.report.page import render
from tests.view.report.compared import Wrong, add_poses, recorded, tracks
from tests.view.report.known import Tape


@pytest.fixture(scope="module")
def scaled(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("against") / "scaled.mcap", Wrong(scale=1.02, lag=0.04))


def rows_of(chapter, title):
    (table,) = (one for one in chapter.sheets if one.title.startswith(title))
    return {row[0]: dict(zip(table.head, row, strict=True)) for row in table.rows}


def test_a_recording_has_its_chapter_where_it_is_asked_for(scaled):
    assert report_of(scaled, None).chapters == []
    (chapter,) = report_of(scaled, None, against="mocap").chapters
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


def test_offsets_are_shown_with_and_without(tmp_path):
    path = recorded(tmp_path / "mounted.mcap", Wrong(turn=(0.0, 0.0, 0.05)))
    (chapter,) = report_of(path, None, against="mocap").chapters
    yaw = rows_of(chapter, "Errors")["yaw (deg)"]
    assert float(yaw["as recorded"].split(" / ")[0]) == pytest.approx(2.86, abs=0.05)
    assert float(yaw["without offsets and lag"].split(" / ")[0]) < 0.2
    assert any("mounting, yaw +2.8" in one for one in chapter.sentences)


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
    page = render(report_of(scaled, None, against="mocap"), "library").decode()
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
