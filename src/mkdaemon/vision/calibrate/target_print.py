"""Pages to SVG and PDF in true size. Both formats take outlines as they are, so no library stands between."""

from __future__ import annotations

import math
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from mkdaemon.errors import ConfigError
from mkdaemon.files import save
from mkdaemon.vision.calibrate.target_shapes import Page

Array = npt.NDArray[np.float64]

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


def write_page(page: Page, path: Path, *, tile: str | None = None, overwrite: bool = False) -> None:
    """Write a page to `path`, `.svg` or `.pdf`; a PDF may be cut into tiles for a smaller printer.

    Args:
        page: what to print.
        path: where; its suffix tells the format.
        tile: paper to cut the page for, one of `PAPERS_MM`; PDF only.
        overwrite: replace a file that is there.

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
        content = pdf(page, PAPERS_MM[tile.lower()] if tile is not None else None)
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
        colour = "#fff" if area.white else "#000"
        lines.append(f'<path fill="{colour}" fill-rule="evenodd" d="{path}"/>')
    for w in page.words:
        place = f'x="{w.x:.4f}" y="{w.y:.4f}" font-family="sans-serif" font-size="{w.height / 0.7:.3f}"'
        lines.append(f"<text {place}>{escape(w.text)}</text>")
    return "\n".join([*lines, "</svg>", ""])


def pdf(page: Page, paper_mm: tuple[float, float] | None = None) -> bytes:
    """A PDF 1.4 of one page in its own size, or of as many sheets of `paper_mm` as it takes."""
    sheets = _tiles(page, paper_mm) if paper_mm is not None else [(page.width, page.height, 0.0, 0.0, "")]
    drawing = _drawing(page)
    objects: list[bytes] = []
    kids = " ".join(f"{4 + 2 * k} 0 R" for k in range(len(sheets)))
    objects.append(b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>")
    objects.append(f"<< /Type /Pages /Kids [{kids}] /Count {len(sheets)} >>".encode())
    objects.append(b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>")
    for k, (width, height, left, top, label) in enumerate(sheets):
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width * POINTS_PER_MM:.4f} {height * POINTS_PER_MM:.4f}]"
            f" /Resources << /Font << /F1 3 0 R >> >> /Contents {5 + 2 * k} 0 R >>".encode()
        )
        frame = _frame(width, height, left, top)
        marks = _tile_marks(width, height, label) if label else ""
        stream = f"q\n{frame}{drawing}Q\n{marks}".encode("cp1252", "replace")
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
    """Content in millimetres, y down; `_frame` turns it into PDF's points, y up."""
    lines = []
    for area in page.areas:
        lines.append("1 g" if area.white else "0 g")
        for loop in area.loops:
            first, *rest = (f"{x:.4f} {y:.4f}" for x, y in loop)
            lines.append(f"{first} m " + " ".join(f"{point} l" for point in rest) + " h")
        lines.append("f*")
    lines.append("0 g")
    lines += [
        f"BT /F1 {w.height / 0.7:.3f} Tf 1 0 0 -1 {w.x:.4f} {w.y:.4f} Tm ({_pdf_text(w.text)}) Tj ET"
        for w in page.words
    ]
    return "\n".join(lines) + "\n"


def _frame(width: float, height: float, left: float, top: float) -> str:
    """Clip to the sheet, millimetres with y down, the page's point (left, top) at the sheet's corner."""
    p = POINTS_PER_MM
    clip = f"0 0 {width * p:.4f} {height * p:.4f} re W n\n"
    return clip + f"{p:.8f} 0 0 {-p:.8f} {-left * p:.4f} {(height + top) * p:.4f} cm\n"


def _tiles(page: Page, paper_mm: tuple[float, float]) -> list[tuple[float, float, float, float, str]]:
    """Sheets that cover the page, turned whichever way needs fewer."""
    options = []
    for width, height in (paper_mm, paper_mm[::-1]):
        step_x, step_y = width - 2 * EDGE_MM - OVERLAP_MM, height - 2 * EDGE_MM - OVERLAP_MM
        columns = max(math.ceil((page.width - OVERLAP_MM) / step_x), 1)
        rows = max(math.ceil((page.height - OVERLAP_MM) / step_y), 1)
        options.append(
            [
                (
                    width,
                    height,
                    column * step_x - EDGE_MM,
                    row * step_y - EDGE_MM,
                    f"row {row + 1} of {rows}, column {column + 1} of {columns}",
                )
                for row in range(rows)
                for column in range(columns)
            ]
        )
    return min(options, key=len)


def _tile_marks(width: float, height: float, label: str) -> str:
    """Crosses in the middle of the shared strips, to lay tiles on each other, and the tile's place."""
    p = POINTS_PER_MM
    lines = ["0.5 G 0.3 w"]
    reach = EDGE_MM + OVERLAP_MM / 2
    for x in (reach, width - reach):
        for y in (reach, height - reach):
            lines.append(f"{(x - 3) * p:.3f} {y * p:.3f} m {(x + 3) * p:.3f} {y * p:.3f} l S")
            lines.append(f"{x * p:.3f} {(y - 3) * p:.3f} m {x * p:.3f} {(y + 3) * p:.3f} l S")
    lines.append(f"BT /F1 7 Tf {EDGE_MM * p:.3f} {3 * p:.3f} Td ({_pdf_text(label)}) Tj ET")
    return "\n".join(lines) + "\n"


def _pdf_text(text: str) -> str:
    return text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
