"""Prints read back: parsed by other means, rasterised, found by the detector, measured in millimetres."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pyapriltags
import pytest

from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.errors import ConfigError
from mkdaemon.vision.calibrate.board import CharucoBoard
from mkdaemon.vision.calibrate.target_print import (
    PAPERS_MM,
    board_page,
    pdf,
    svg,
    target_page,
    tiles,
    write_page,
)
from mkdaemon.vision.tags.tagmap import Target, build, single

PX_PER_MM = 4
NESTED = build(
    [TargetSection(name="pad", tags=(TagPlacement(id=48, size=0.16), TagPlacement(id=1, size=0.028)))], origin="test"
).targets[0]


def paint(width: float, height: float, shapes: list[tuple[int, list[np.ndarray]]]) -> np.ndarray:
    """Rasterise even-odd polygons, four pixels a millimetre; sub-pixel edges through four-fold super-sampling."""
    fine = 4 * PX_PER_MM
    image = np.full((round(height * fine), round(width * fine)), 255, np.uint8)
    for grey, loops in shapes:
        cv2.fillPoly(image, [np.rint(loop * fine - 0.5).astype(np.int32) for loop in loops], grey)
    return cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)


def paint_svg(text: str) -> np.ndarray:
    root = ET.fromstring(text)
    assert root.get("width", "").endswith("mm")
    width, height = (float(root.get(key, "").removesuffix("mm")) for key in ("width", "height"))
    assert root.get("viewBox") == f"0 0 {width:.4f} {height:.4f}"
    shapes = []
    for path in root.findall("{http://www.w3.org/2000/svg}path"):
        parts = path.get("d", "").split("Z")[:-1]
        loops = [np.array([[float(v) for v in point.split()] for point in part[1:].split("L")]) for part in parts]
        shapes.append((int(path.get("fill", "")[-2:], 16), loops))
    return paint(width, height, shapes)


def grab(pattern: bytes, text: bytes) -> bytes:
    match = re.search(pattern, text)
    assert match is not None, pattern
    return match[1]


def pdf_pages(content: bytes) -> list[tuple[float, float, np.ndarray, str]]:
    """Size [mm], matrix and drawing of each page of a PDF, read by cross-reference table."""
    start = int(grab(rb"startxref\n(\d+)", content))
    places = [int(m) for m in re.findall(rb"(\d{10}) 00000 n", content[start:])]
    objects = {int(content[p:].split(b" ")[0]): content[p:].split(b"endobj")[0] for p in places}
    pages = []
    for body in objects.values():
        if b"/Type /Page " in body:
            box = [float(v) for v in grab(rb"MediaBox \[(.*?)\]", body).split()]
            stream = objects[int(grab(rb"/Contents (\d+)", body))]
            length = int(grab(rb"/Length (\d+)", stream))
            raw = stream[stream.index(b"stream\n") + 7 :][:length]
            a, b, c, d, e, f = (float(v) for v in grab(rb"(.*) cm\n", raw).split())
            pages.append(
                (box[2] * 25.4 / 72, box[3] * 25.4 / 72, np.array([[a, c, e], [b, d, f]]), raw.decode("cp1252"))
            )
    return pages


def paint_pdf(width: float, height: float, matrix: np.ndarray, drawn: str) -> np.ndarray:
    shapes, grey, loops = [], 0, []
    for line in drawn.splitlines():
        if line in ("0 g", "1 g"):
            grey = 255 if line == "1 g" else 0
        elif line.endswith(" h"):
            numbers = np.array([float(v) for v in re.findall(r"-?[\d.]+", line)]).reshape(-1, 2)
            points = np.column_stack([numbers, np.ones(len(numbers))]) @ matrix.T
            loops.append(np.column_stack([points[:, 0] * 25.4 / 72, height - points[:, 1] * 25.4 / 72]))
        elif line == "f*":
            shapes.append((grey, loops))
            loops = []
    return paint(width, height, shapes)


def corners_mm(image: np.ndarray) -> dict[int, np.ndarray]:
    detector = pyapriltags.Detector(families="tag36h11", quad_decimate=1.0)
    return {tag.tag_id: tag.corners[[3, 2, 1, 0]] / PX_PER_MM for tag in detector.detect(image)}


def assert_true_size(image: np.ndarray, target: Target) -> None:
    found = corners_mm(image)
    # A decoder reports the inner tag of a nested pair as well as the outer one.
    assert found.keys() == {tag.tag_id for tag in target.tags}
    for tag in target.tags:
        sides = np.linalg.norm(found[tag.tag_id] - np.roll(found[tag.tag_id], 1, axis=0), axis=1)
        np.testing.assert_allclose(sides, 1000 * tag.size, atol=0.12)
        top_left, top_right = found[tag.tag_id][:2]
        assert top_left[0] < top_right[0]  # upright, not mirrored
        assert abs(top_left[1] - top_right[1]) < 0.2


@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_a_target_is_found_in_its_true_size(form: str) -> None:
    page = target_page(NESTED)
    assert_true_size(paint_svg(svg(page)) if form == "svg" else paint_pdf(*pdf_pages(pdf([page]))[0]), NESTED)


def test_a_charuco_board_is_found_with_its_corners_in_place() -> None:
    board = CharucoBoard(7, 5, 0.024)
    image = paint_svg(svg(board_page(board)))
    found = board.find(image)
    assert len(found.ids) == 6 * 4
    offset = found.image / PX_PER_MM - 1000 * found.board[:, :2]
    np.testing.assert_allclose(offset - offset.mean(axis=0), 0.0, atol=0.1)


def test_tiles_cover_the_page_and_carry_the_true_size() -> None:
    page = target_page(single(0.3048, 7))
    sheets = tiles(page, PAPERS_MM["a4"])
    printed = pdf_pages(pdf(sheets))
    assert len(sheets) == len(printed) == 6
    whole = paint_svg(svg(page))
    covered = np.zeros((round(page.height), round(page.width)), bool)
    for sheet, (width, height, matrix, drawn) in zip(sheets, printed, strict=True):
        assert sorted((round(width), round(height))) == [210, 297]
        assert matrix[0, 0] * 25.4 / 72 == pytest.approx(1.0, abs=1e-6)
        left, top = page.areas[0].loops[0][0] - sheet.areas[0].loops[0][0]
        shown = paint_pdf(width, height, matrix, drawn)
        here, there = ([max(round(way * far) * PX_PER_MM, 0) for far in (top, left)] for way in (1, -1))
        part, seen = whole[here[0] :, here[1] :], shown[there[0] :, there[1] :]
        rows, columns = np.minimum(part.shape, seen.shape)
        assert np.abs(part[:rows, :columns].astype(int) - seen[:rows, :columns]).mean() < 1.0
        x0, y0 = max(round(left + 8), 0), max(round(top + 8), 0)
        covered[y0 : round(top + height - 8), x0 : round(left + width - 8)] = True
    assert covered.all()


def test_the_ruler_is_as_long_as_it_says() -> None:
    image = paint_svg(svg(target_page(single(0.16, 7))))
    strip = image[219 * PX_PER_MM :]  # under a sheet of 200 mm and its margins
    rows = np.flatnonzero((strip < 200).sum(axis=1) > 60 * PX_PER_MM)
    line = np.flatnonzero(strip[rows[0]] < 200)
    assert (line[-1] - line[0] + 1) / PX_PER_MM == pytest.approx(100.0, abs=0.3)


def test_a_target_that_is_not_flat_cannot_be_one_print() -> None:
    side = TagPlacement(id=1, size=0.1, rpy_deg=(90.0, 0.0, 0.0), position=(0.0, 0.2, 0.2))
    box = TargetSection(name="box", tags=(TagPlacement(id=0, size=0.1), side))
    with pytest.raises(ConfigError, match="not flat"):
        target_page(build([box], origin="test").targets[0])


@pytest.mark.parametrize(
    ("name", "tile", "words"),
    [
        ("x.png", None, ".svg or .pdf"),
        ("x.svg", "a4", "use one of"),
        ("x.pdf", "a9", "use one of"),
        ("no/x.pdf", None, "there is no folder"),
    ],
)
def test_what_cannot_be_written_is_named(name: str, tile: str | None, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words):
        write_page(target_page(NESTED), tmp_path / name, tile=tile)
