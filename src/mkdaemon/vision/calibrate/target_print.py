"""Printed targets: what is on a page, in millimetres, and the page as SVG or PDF in true size."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import escape

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import ConfigError
from mkdaemon.files import save
from mkdaemon.vision.arrays import Array
from mkdaemon.vision.calibrate.board import CELLS_PER_SQUARE, CharucoBoard
from mkdaemon.vision.tags.tagfamily import size_words
from mkdaemon.vision.tags.tagmap import Tag, Target

MARGIN_MM = 10.0
"""White around everything: printers leave a rim blank."""
LONG_MARKS = {0: 5.0, 5: 3.5}
"""Of the ruler [mm], by the last digit of where they are."""
LISTED = 6
"""Tags that are named in the title of a page."""
RULER_MM = 100
FOOT_MM = 24.0
"""Height of the strip with ruler and text under a target."""
POINTS_PER_MM = 72.0 / 25.4
"""A PDF unit is 1/72 inch (ISO 32000-1, 8.3.2.3)."""
PAPERS_MM = {
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
}
"""ISO 216 sizes, upright."""
OVERLAP_MM = 10.0
"""Strip that neighbouring tiles share."""
EDGE_MM = 8.0
"""Rim of a tile most printers leave blank."""


@dataclass(frozen=True, slots=True)
class Area:
    """Closed polygons `(n, 2)` [mm; page, x right, y down] in grey, 0 black to 1 white, filled by the even-odd rule."""

    loops: tuple[Array, ...]
    grey: float = 0.0


@dataclass(frozen=True, slots=True)
class TextLine:
    """A line of text: left end of its baseline [mm; page], height of its capitals [mm]."""

    x: float
    y: float
    height: float
    text: str


@dataclass(frozen=True, slots=True)
class Page:
    """Everything on one sheet of `width` x `height` [mm]."""

    width: float
    height: float
    areas: tuple[Area, ...]
    words: tuple[TextLine, ...]
    title: str


def outlines(cells: npt.NDArray[np.bool_]) -> list[Array]:
    """Closed loops `(n, 2)` of (column, row) corners around the set cells: rectangles would leave hairlines between."""
    # A contour runs through the outermost pixels, which lie beside the corners where a cell has three by three.
    pixels = np.kron(cells, np.ones((3, 3))).astype(np.uint8)
    loops, _ = cv2.findContours(pixels, cv2.RETR_TREE, cv2.CHAIN_APPROX_SIMPLE)
    return [np.asarray((loop[:, 0] + 1) // 3, np.float64) for loop in loops]


def target_page(target: Target) -> Page:
    """Lay out a flat target with cut marks, ruler and sizes.

    Raises:
        ConfigError: the target is not flat.
    """
    if not target.is_planar or not np.allclose(target.tags[0].rotation[:, 2], (0.0, 0.0, 1.0)):
        msg = f"target '{target.name}' is not flat: print its tags one by one with --tag ID:SIZE"
        raise ConfigError(msg)
    sheets = np.concatenate([_paper(tag) for tag in target.tags])
    (x0, y0, _), (x1, y1, _) = sheets.min(axis=0), sheets.max(axis=0)

    def on_page(points: Array) -> Array:
        return 1000.0 * np.column_stack([points[:, 0] - x0, y1 - points[:, 1]]) + MARGIN_MM

    areas = []
    for tag in target.tags:
        half = tag.bitmap.shape[0] / 2
        ink = (
            np.column_stack([loop[:, 0] - half, half - loop[:, 1]]) * tag.module for loop in outlines(tag.bitmap == 0)
        )
        areas += [Area((on_page(_paper(tag)),), grey=1.0), Area(tuple(on_page(tag.place(loop)) for loop in ink))]
    sizes = ", ".join(f"{tag.family.name} {tag.tag_id} = {1000 * tag.size:g} mm" for tag in target.tags[:LISTED])
    more = f" and {len(target.tags) - LISTED} more" if len(target.tags) > LISTED else ""
    width, height = 1000.0 * (x1 - x0), 1000.0 * (y1 - y0)
    measured = " or ".join(dict.fromkeys(size_words(tag.family) for tag in target.tags))
    return _finished(areas, width, height, f"{target.name}: {sizes}{more} ({measured})")


def board_page(board: CharucoBoard) -> Page:
    """Lay out a ChArUco board with ruler and sizes."""
    cell = 1000.0 * board.square / CELLS_PER_SQUARE
    loops = [loop * cell + MARGIN_MM for loop in outlines(board.cells == 0)]
    width, height = 1000.0 * board.square * board.columns, 1000.0 * board.square * board.rows
    return _finished([Area(tuple(loops))], width, height, board.title)


def _paper(tag: Tag) -> Array:
    return tag.place(tag.paper / 2 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]))


def _finished(areas: Iterable[Area], width: float, height: float, title: str) -> Page:
    """Add cut marks, both rulers and the texts."""
    page_width = max(width, RULER_MM) + 2 * MARGIN_MM + 6.0
    foot = height + 2 * MARGIN_MM
    marks = [*_cut_marks(width, height), *_ruler(MARGIN_MM, foot)]
    if height >= RULER_MM:
        marks += [(page_width - 5.0 - (y - foot), x, h, w) for x, y, w, h in _ruler(MARGIN_MM, foot)]
    lines = (
        f"This ruler is {RULER_MM} mm. Measure it: a print 1 % too large is a pose 1 % too far.",
        title,
        "Print at 100 %, on matte paper, mounted flat. Measure, then correct the size in the file.",
    )
    words = [TextLine(MARGIN_MM, foot + 11.0 + 5.0 * k, 2.5, line) for k, line in enumerate(lines)]
    return Page(page_width, foot + FOOT_MM, (*areas, *(_box(*mark) for mark in marks)), tuple(words), title)


def _box(x: float, y: float, width: float, height: float, grey: float = 0.0) -> Area:
    return Area((np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]]),), grey)


def _cut_marks(width: float, height: float) -> list[tuple[float, float, float, float]]:
    """Short lines outside the corners."""
    marks = []
    for x, y in itertools.product((MARGIN_MM, MARGIN_MM + width), (MARGIN_MM, MARGIN_MM + height)):
        marks.append((x + (2 if x > MARGIN_MM else -6), y - 0.1, 4.0, 0.2))
        marks.append((x - 0.1, y + (2 if y > MARGIN_MM else -6), 0.2, 4.0))
    return marks


def _ruler(x: float, y: float) -> list[tuple[float, float, float, float]]:
    """Millimetre marks and a line; the first and last mark's outer edges are exactly `RULER_MM` apart."""
    line = 0.15
    marks = [(x, y, float(RULER_MM), line)]
    for mm in range(RULER_MM + 1):
        at = min(max(mm - line / 2, 0.0), RULER_MM - line)
        marks.append((x + at, y, line, LONG_MARKS.get(mm % 10, 2.0)))
    return marks


def write_page(page: Page, path: Path, *, tile: str | None = None, overwrite: bool = False) -> None:
    """Write a page to `path`, `.svg` or `.pdf`; a PDF may be cut into tiles for smaller paper, one of `PAPERS_MM`.

    Raises:
        ConfigError: unknown suffix or paper, or the file is there already.
        MkError: the file cannot be written; what was there is untouched.
    """
    suffix = path.suffix.lower()
    if tile is not None and (tile.lower() not in PAPERS_MM or suffix != ".pdf"):
        msg = f"tiles on '{tile}' in {path.name}: use one of {', '.join(PAPERS_MM)} and a .pdf file"
        raise ConfigError(msg)
    if suffix == ".svg":
        content = svg(page).encode()
    elif suffix == ".pdf":
        content = pdf([page] if tile is None else tiles(page, PAPERS_MM[tile.lower()]))
    else:
        msg = f"{path}: give a file that ends in .svg or .pdf"
        raise ConfigError(msg)
    save(path, content, overwrite=overwrite)


def svg(page: Page) -> str:
    """One SVG whose user unit is a millimetre."""
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{page.width:.4f}mm" height="{page.height:.4f}mm"'
        f' viewBox="0 0 {page.width:.4f} {page.height:.4f}">',
        f"<title>{escape(page.title)}</title>",
        '<rect width="100%" height="100%" fill="#fff"/>',
    ]
    for area in page.areas:
        path = "".join("M" + "L".join(f"{x:.4f} {y:.4f}" for x, y in loop) + "Z" for loop in area.loops)
        colour = f"{round(255 * area.grey):02x}" * 3
        lines.append(f'<path fill="#{colour}" fill-rule="evenodd" d="{path}"/>')
    for w in page.words:
        place = f'x="{w.x:.4f}" y="{w.y:.4f}" font-family="sans-serif" font-size="{w.height / 0.7:.3f}"'
        lines.append(f"<text {place}>{escape(w.text)}</text>")
    return "\n".join([*lines, "</svg>", ""])


def pdf(sheets: Sequence[Page]) -> bytes:
    """A PDF 1.4 of pages, each in its own size."""
    kids = " ".join(f"{4 + 2 * k} 0 R" for k in range(len(sheets)))
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(sheets)} >>".encode(),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    for k, page in enumerate(sheets):
        width, height = page.width * POINTS_PER_MM, page.height * POINTS_PER_MM
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}]"
            f" /Resources << /Font << /F1 3 0 R >> >> /Contents {5 + 2 * k} 0 R >>".encode()
        )
        stream = _drawing(page).encode("cp1252", "replace")
        objects.append(b"<< /Length %d >>\nstream\n" % len(stream) + stream + b"endstream")
    return _assembled(objects)


def _assembled(objects: list[bytes]) -> bytes:
    """Number the objects and write the cross-reference table (ISO 32000-1, 7.5)."""
    out = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")
    places = []
    for number, content in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n" % number + content + b"\nendobj\n"
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % place for place in places)
    out += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, start)
    return bytes(out)


def _drawing(page: Page) -> str:
    """What is on a page: millimetres, y down."""
    lines = [f"q\n{POINTS_PER_MM:.8f} 0 0 {-POINTS_PER_MM:.8f} 0 {page.height * POINTS_PER_MM:.4f} cm"]
    for area in page.areas:
        lines.append(f"{area.grey:g} g")
        for loop in area.loops:
            first, *rest = (f"{x:.4f} {y:.4f}" for x, y in loop)
            lines.append(f"{first} m " + " ".join(f"{point} l" for point in rest) + " h")
        lines.append("f*")
    lines.append("0 g")
    for w in page.words:
        text = w.text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
        lines.append(f"BT /F1 {w.height / 0.7:.3f} Tf 1 0 0 -1 {w.x:.4f} {w.y:.4f} Tm ({text}) Tj ET")
    return "\n".join([*lines, "Q", ""])


def tiles(page: Page, paper_mm: tuple[float, float]) -> list[Page]:
    """Sheets that cover the page, turned whichever way needs fewer; crosses in the strips they share."""
    options = []
    for width, height in (paper_mm, paper_mm[::-1]):
        step_x, step_y = width - 2 * EDGE_MM - OVERLAP_MM, height - 2 * EDGE_MM - OVERLAP_MM
        columns = max(math.ceil((page.width - OVERLAP_MM) / step_x), 1)
        rows = max(math.ceil((page.height - OVERLAP_MM) / step_y), 1)
        reach, line = EDGE_MM + OVERLAP_MM / 2, 0.1
        crosses: list[Area] = []
        for x, y in itertools.product((reach, width - reach), (reach, height - reach)):
            crosses += [_box(x - 3, y - line / 2, 6, line, 0.5), _box(x - line / 2, y - 3, line, 6, 0.5)]
        sheets = []
        for row, column in np.ndindex(rows, columns):
            x, y = move = np.array([EDGE_MM - column * step_x, EDGE_MM - row * step_y])
            areas = (Area(tuple(loop + move for loop in area.loops), area.grey) for area in page.areas)
            words = (replace(line, x=line.x + x, y=line.y + y) for line in page.words)
            place = TextLine(EDGE_MM, height - 3, 1.7, f"row {row + 1} of {rows}, column {column + 1} of {columns}")
            sheets.append(Page(width, height, (*areas, *crosses), (*words, place), page.title))
        options.append(sheets)
    return min(options, key=len)
