"""A known lens is recovered from rendered boards, with honest uncertainties; poor calibrations are refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from mkdaemon.config.camera import MountSection
from mkdaemon.config.vision import BoardSection, TargetSection
from mkdaemon.errors import ConfigError, VisionError
from mkdaemon.vision.calibrate.board import BoardPoints, CharucoBoard, TagBoard
from mkdaemon.vision.calibrate.calibration import CalibrationResult, calibrate
from mkdaemon.vision.calibrate.views import Views
from mkdaemon.vision.camera.calibration_file import CalibrationRecord, Camera, load_camera, mount_rotation, save_camera
from mkdaemon.vision.tags.tagmap import build
from mksim.scene.flights import FLU_FROM_CAM_DOWN
from mksim.scene.layers import board_layer, sheet_layer, tag_layer
from mksim.scene.view import project

from .boardviews import LENS, PLACES, board_views

CHARUCO = CharucoBoard(9, 6, 0.03)
TAGS = build(
    [TargetSection(name="board", board=BoardSection(first_id=100, rows=4, columns=6, size=0.036, spacing=0.009))],
    origin="test",
).targets[0]


BOARD = board_layer(CHARUCO.cells, 0.27, 0.18)


def found_in(images: list[np.ndarray], board: CharucoBoard | TagBoard = CHARUCO) -> list[BoardPoints]:
    return [view for image in images if (view := board.find(image)) is not None]


@cache
def charuco_views() -> list[BoardPoints]:
    return found_in(board_views((BOARD,), 0.27))


@cache
def charuco_result() -> CalibrationResult:
    return calibrate(charuco_views())


def assert_lens(result: CalibrationResult) -> None:
    for name in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"):
        error = getattr(result.intrinsics, name) - getattr(LENS, name)
        assert abs(error) < 4.5 * result.sd[name] + 1e-6, (name, error, result.sd[name])
    assert abs(result.intrinsics.fx / LENS.fx - 1) < 0.003
    assert abs(result.intrinsics.cx - LENS.cx) < 1.0


def test_a_known_lens_is_recovered_from_a_charuco_board() -> None:
    assert len(charuco_views()) == len(PLACES)
    result = charuco_result()
    assert_lens(result)
    assert result.rms_px < 0.15
    assert result.faults() == []


def test_a_known_lens_is_recovered_from_a_tag_board() -> None:
    layers = (sheet_layer(0.28, 0.19), *(tag_layer(tag) for tag in TAGS.tags))
    views = found_in(board_views(layers, 0.27, places=PLACES[:8]), TagBoard(TAGS))
    assert len(views) >= 7
    result = calibrate(views)
    assert abs(result.intrinsics.fx / LENS.fx - 1) < 0.004
    assert result.rms_px < 0.3
    assert found_in([np.full((480, 640), 128, np.uint8)], TagBoard(TAGS)) == []


def test_a_view_that_moved_is_left_out() -> None:
    views = list(charuco_views())
    sheared = views[3].image + 0.02 * (views[3].image - views[3].image.mean(axis=0))[:, ::-1]
    views[3] = replace(views[3], image=sheared)
    result = calibrate(views)
    assert 3 not in result.used
    assert_lens(result)


def test_noise_and_flat_views_are_refused_with_the_reason() -> None:
    rng = np.random.default_rng(1)
    shaken = [replace(view, image=view.image + rng.normal(0, 0.8, view.image.shape)) for view in charuco_views()]
    assert any("rms" in fault for fault in calibrate(shaken).faults())
    front = tuple((0.5, 0.5, 1.2 + 0.01 * k, 2, 1, 10 * k) for k in range(7))
    flat = found_in(board_views((BOARD,), 0.27, places=front))
    assert any("from the front alone" in fault for fault in calibrate(flat).faults())


def test_too_few_views_say_how_many_are_needed() -> None:
    with pytest.raises(VisionError, match=r"3 views of the board, at least 6"):
        calibrate(charuco_views()[:3])


@pytest.mark.parametrize(("rows", "points"), [(0, None), (2, None), (3, 16)])
def test_corners_on_one_line_are_no_view(rows: int, points: int | None) -> None:
    image = np.full((400, 440), 255, np.uint8)
    image[20 : 20 + 40 * rows, 40:400] = np.kron(CHARUCO.cells[: 8 * rows], np.ones((5, 5), np.uint8))
    found = CHARUCO.find(image)
    assert (None if found is None else len(found.ids)) == points


@pytest.mark.parametrize("size", [(2, 6, 0.03), (40, 40, 0.03), (6, 6, 0.0)])
def test_impossible_boards_are_refused(size: tuple[int, int, float]) -> None:
    with pytest.raises(ConfigError, match="board"):
        CharucoBoard(*size)


def test_coverage_leads_from_nothing_to_enough() -> None:
    views = Views(CHARUCO)
    first = views.missing()
    assert any("top left" in words for words in first)
    assert len([words for words in first if "lean" in words or "turn" in words]) == 4
    shares = []
    for view in charuco_views():
        assert views.is_novel(view)
        views.add(view)
        assert not views.is_novel(view)
        shares.append(views.share())
    assert shares == sorted(shares)
    assert views.missing() == []


def test_a_camera_file_comes_back_as_it_went(tmp_path: Path) -> None:
    result = charuco_result()
    camera = Camera(
        name='a "wide" lens \\ 2.8 mm\n\x7f',
        intrinsics=result.intrinsics,
        mount=MountSection(position_flu=(0.1, 0.0, -0.05), looks="down", rpy_deg=(0.5, -1.0, 0.0)),
        calibration=CalibrationRecord(date="2026-05-01", views=14, rms_px=0.11, forced=True),
    )
    path = tmp_path / "camera.toml"
    save_camera(camera, path)
    assert load_camera(path) == camera


BY_HAND = "[intrinsics]\nwidth = 640\nheight = 480\nfx = 600.0\nfy = 600\ncx = 319.5\ncy = 239.5\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "intrinsics: must be given"),
        ("[intrinsics]\nwidth = 640\nheight = 480\nfx = -1.0\nfy = 1.0\ncx = 1.0\ncy = 1.0\n", "intrinsics.fx"),
        ("[intrinsics\n", "not valid TOML"),
        (
            "[intrinsics]\nwidth = 640\nheight = 480\nfx = 1.0\nfy = 1.0\ncx = 1.0\ncy = 1.0\nk9 = 1.0\n",
            "intrinsics.k9: unknown key",
        ),
        (BY_HAND.replace("[intrinsics]", "[intrinsic]"), 'unknown key; did you mean "intrinsics"?'),
        (BY_HAND.replace("fx = 600.0", "fx = true"), "intrinsics.fx"),
        (BY_HAND.replace("fx = 600.0", "fx = nan"), "intrinsics.fx"),
        (BY_HAND.replace("fx = 600.0", "fx = 60.0"), "no lens has a focal length of 60, 600 px on 640x480"),
        (BY_HAND.replace("fx = 600.0", "fx = 6000.0"), "differ too much"),
        (BY_HAND.replace("cx = 319.5", "cx = 3195"), "the centre 3195, 239.5 is outside the 640x480 image"),
    ],
)
def test_a_wrong_camera_file_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"camera file .*camera\.toml(:\d+)?: ") as caught:
        load_camera(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_figures_no_lens_has_are_not_stored(tmp_path: Path) -> None:
    wild = Camera(intrinsics=LENS.model_copy(update={"fx": 60000.0, "fy": 60000.0}))
    with pytest.raises(ConfigError, match="not written: no lens has a focal length"):
        save_camera(wild, tmp_path / "camera.toml")
    assert not list(tmp_path.iterdir())
    with pytest.raises(ConfigError, match=r"no such configuration file.*mkdaemon calibrate camera"):
        load_camera(tmp_path / "camera.toml")


def test_mounts_look_where_they_say_and_lean_by_their_angles() -> None:
    for looks, direction in zip(("forward", "left", "up"), np.eye(3), strict=True):
        opposite = {"forward": "back", "left": "right", "up": "down"}[looks]
        for name, expected in ((looks, direction), (opposite, -direction)):
            rotation = mount_rotation(MountSection.model_validate({"looks": name}))
            np.testing.assert_allclose(rotation[:, 2], expected, atol=1e-12)
            assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(mount_rotation(MountSection()), FLU_FROM_CAM_DOWN, atol=1e-12)
    nose_up = mount_rotation(MountSection(looks="forward", rpy_deg=(0.0, -10.0, 0.0)))
    assert nose_up[2, 2] == pytest.approx(np.sin(np.radians(10.0)))


FISHEYE = LENS.model_copy(
    update={"model": "fisheye", "fx": 250.0, "fy": 251.0, "k1": -0.03, "k2": 0.004, "p1": 0.0, "p2": 0.0}
)


def test_a_fisheye_is_recovered_from_points_with_noise() -> None:
    rng = np.random.default_rng(5)
    grid = np.array([[0.03 * x, 0.03 * y, 0.0] for y in range(5) for x in range(8)])
    views = []
    for k in range(24):
        turn = cv2.Rodrigues(np.radians([35.0 * np.sin(2.1 * k), 35.0 * np.cos(1.7 * k), 40.0 * k]))[0]
        aside = 0.16 * np.array([np.cos(1.3 * k), np.sin(0.9 * k), 0.0])
        seen = (grid - grid.mean(axis=0)) @ turn.T + aside + [0.0, 0.0, 0.16 + 0.05 * (k % 3)]
        pixels = project(seen, FISHEYE) + 0.08 * rng.standard_normal((len(grid), 2))
        views.append(BoardPoints(np.arange(len(grid)), grid, pixels, (640, 480)))
    result = calibrate(views, is_fisheye=True)
    assert result.intrinsics.model == "fisheye"
    for name in ("fx", "fy", "cx", "cy", "k1"):
        error = getattr(result.intrinsics, name) - getattr(FISHEYE, name)
        assert abs(error) < 4.0 * result.sd[name], name
    assert result.focal_sd_percent < 0.2
    with pytest.raises(VisionError, match="no fisheye"):
        calibrate([replace(view, image=np.zeros_like(view.image)) for view in views], is_fisheye=True)
