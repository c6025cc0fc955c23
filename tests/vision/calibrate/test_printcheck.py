"""Prints judged by one photograph: another renderer's images, rendered views, and what is wrong with them."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.vision.calibrate.printcheck import PrintState, check_print
from mkdaemon.vision.camera.calibration_file import Camera, save_camera
from mkdaemon.vision.tags.tagmap import single
from mksim.scene.curl import Curl
from mksim.scene.light import LightConditions
from tests.places import CONFIGS
from tests.vision.test_still import CAMERA, ROWS, WEBOTS
from tests.vision.views import VGA, View, place, printed, shipped

GOOD, BAD, UNKNOWN = PrintState.GOOD, PrintState.BAD, PrintState.UNKNOWN
NESTED = CONFIGS / "targets" / "nested.toml"


def states(findings):
    return {finding.name: finding.state for finding in findings}


def words(findings, name):
    return next(finding.words for finding in findings if finding.name == name)


def number(findings, name):
    """The first figure of a finding [%]."""
    return float(words(findings, name).split()[0])


def picture(index):
    return np.asarray(cv2.imread(str(WEBOTS / f"img-{index:03d}.png"), cv2.IMREAD_GRAYSCALE), np.uint8)


def sheet(stretch=1.0, cells_of_rim=3):
    """A tag of 20 cm from the front, its height stretched."""
    upright = cv2.resize(printed(single(0.2, 14).tags[0].bitmap), None, fx=1.5, fy=1.5 * stretch)
    canvas = np.full((480, 640), 235, np.uint8)
    canvas[20 : 20 + upright.shape[0], 40 : 40 + upright.shape[1]] = np.clip(upright, 12, 235)
    black = 40 + 90  # first black column
    canvas[:, : black - round(30 * cells_of_rim)] = 60
    return np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.8), np.uint8)


@pytest.mark.parametrize("row", ROWS[::3], ids=lambda row: row["name"])
def test_a_right_print_of_another_renderer_is_good_from_every_side(row):
    distance = float(np.linalg.norm([float(row[key]) for key in ("horizontal", "vertical", "distance")]))
    found = check_print(picture(int(row["Index"])), single(0.2, 14), CAMERA, distance)
    assert states(found) == {
        "tags": GOOD,
        "sizes among tags": UNKNOWN,  # there is one
        "width over height": GOOD,
        "size": GOOD,
        "flat": GOOD,
        "sharp": GOOD,
        "light": GOOD,
        "white rim": GOOD,
    }


def test_a_nested_print_is_good_and_what_was_not_measured_is_said():
    found = check_print(View(shipped("nested"), place(0.8, 0.1)).pixels, shipped("nested"), VGA)
    assert states(found) == dict.fromkeys(states(found), GOOD) | {"size": UNKNOWN}
    assert "cannot tell sizes that are all wrong by one factor" in words(found, "size")


@pytest.mark.parametrize("percent", [-4.0, 3.0])
def test_a_tag_of_another_size_than_its_file_says_is_found_to_half_a_percent(percent):
    target = shipped("nested")
    inner = replace(target.tags[1], size=target.tags[1].size / (1 + percent / 100))
    found = check_print(View(target, place(0.6, 0.3)).pixels, replace(target, tags=(target.tags[0], inner)))
    assert states(found)["sizes among tags"] is BAD
    assert float(words(found, "sizes among tags").split(" is ")[1].split()[0]) == pytest.approx(percent, abs=0.5)


@pytest.mark.parametrize("stretch", [0.96, 1.03])
def test_a_print_that_was_fitted_to_its_page_is_found_with_a_camera_file_alone(stretch):
    found = check_print(sheet(stretch), single(0.2, 14), VGA)
    assert states(found)["width over height"] is BAD
    assert number(found, "width over height") == pytest.approx(100 * (1 / stretch - 1), abs=0.3)
    assert states(check_print(sheet(stretch), single(0.2, 14)))["width over height"] is UNKNOWN


@pytest.mark.parametrize(("percent", "state"), [(1.3, BAD), (0.7, GOOD)])
def test_a_print_that_is_larger_than_its_file_says_is_found_by_the_tape(percent, state):
    view = View(shipped("nested"), place(0.6, 0.3))
    found = check_print(view.pixels, shipped("nested"), VGA, 0.6 * (1 + percent / 100))
    assert states(found)["size"] is state
    assert number(found, "size") == pytest.approx(percent, abs=0.3)


def photo(name: str = "nested", conditions: LightConditions | None = None) -> View:
    return View(shipped(name), place(0.6, 0.3), conditions)


def test_a_bent_print_is_not_flat_and_without_a_camera_file_it_may_be_the_lens():
    bent = photo(conditions=LightConditions(curl=Curl(1.5, 0.5, 0.4))).pixels
    assert states(check_print(bent, shipped("nested"), VGA))["flat"] is BAD
    assert states(check_print(bent, shipped("nested")))["flat"] is UNKNOWN


def test_a_blurred_photograph_judges_no_sizes_and_melted_edges_of_the_largest_tag_no_shape():
    blurred = photo(conditions=LightConditions(defocus_px=9.0)).pixels
    found = states(check_print(blurred, shipped("nested"), VGA))
    assert (found["sharp"], found["sizes among tags"], found["width over height"]) == (BAD, UNKNOWN, GOOD)
    melted = np.asarray(cv2.GaussianBlur(sheet(), (0, 0), 10.0), np.uint8)
    found = states(check_print(melted, single(0.2, 14), VGA, 0.504))
    assert (found["sharp"], found["white rim"]) == (BAD, GOOD)
    assert [found[name] for name in ("width over height", "size", "flat")] == [UNKNOWN] * 3


@pytest.mark.parametrize(
    ("pixels", "name", "state"),
    [
        (sheet(cells_of_rim=1.1), "white rim", GOOD),
        (sheet(cells_of_rim=0.4), "white rim", BAD),
        (np.ascontiguousarray(sheet()[:, 125:]), "white rim", UNKNOWN),
        ((sheet() * 0.15).astype(np.uint8), "light", BAD),
        (np.where(sheet() > 200, 255, sheet()), "light", BAD),
        (cv2.resize(sheet(), None, fx=0.14, fy=0.14, interpolation=cv2.INTER_AREA), "tags", BAD),
    ],
    ids=["rim", "narrow rim", "rim not in view", "dark", "blown", "far"],
)
def test_rim_light_and_distance_are_judged(pixels, name, state):
    assert states(check_print(pixels, single(0.2, 14)))[name] is state


def test_the_command_says_what_is_bad_first(tmp_path, capsys):
    photo, camera = tmp_path / "photo.png", tmp_path / "camera.toml"
    cv2.imwrite(str(photo), View(shipped("nested"), place(0.6, 0.3)).pixels)
    save_camera(Camera(name="test", intrinsics=VGA), camera)
    call = ["calibrate", "check-print", str(photo), "--target", str(NESTED)]
    assert run(app, call) == EXIT_OK
    assert capsys.readouterr().out.startswith("UNKNOWN  width over height")
    assert run(app, [*call, "--camera", str(camera), "--distance", "0.63"]) == EXIT_FAILURE
    out = capsys.readouterr().out
    assert out.startswith("BAD      size: +")
    assert float(out.split()[2]) == pytest.approx(5.0, abs=0.1)
    assert "Measure tag 48 with a ruler: 304.8 mm by its file." in out
    assert run(app, [*call, "--camera", str(camera), "--distance", "0.6", "--json"]) == EXIT_OK
    assert json.loads(capsys.readouterr().out)["is_good"] is True
    nothing = tmp_path / "nothing.png"
    cv2.imwrite(str(nothing), np.full((480, 640), 128, np.uint8))
    assert run(app, ["calibrate", "check-print", str(nothing), "--target", str(NESTED)]) == EXIT_FAILURE
    assert "no tag of the target was found" in capsys.readouterr().out
    cv2.imwrite(str(nothing), np.full((240, 320), 128, np.uint8))
    call = ["calibrate", "check-print", str(nothing), "--target", str(NESTED), "--camera", str(camera)]
    assert run(app, call) == EXIT_CONFIG
    assert "is 320x240, the calibration is for 640x480" in capsys.readouterr().err
    assert run(app, ["calibrate", "check-print", "none.png", "--target", str(NESTED)]) == EXIT_CONFIG
