"""Polynomials of crazyswarm: a CSV file with a line for each piece of a path.

33 columns: duration, then eight coefficients each of x, y, z and yaw, from the constant on. Source: USC-ACTLab,
crazyswarm, `uav_trajectory.py`, `Trajectory.loadcsv`; its lines may end with a comma, and its first line names columns.
Where yaw is zero in all of them, the aircraft keeps its heading.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import LONGEST_SETTINGS, parse_number, read_text
from mkdaemon.missions.source import FilePlace
from mkdaemon.telemetry.path import COEFFICIENTS, MOST_PIECES

COLUMNS: Final = 1 + 4 * COEFFICIENTS
"""Duration, and the coefficients of x, y, z and yaw."""


def read_pieces(path: Path) -> list[dict[str, Any]]:
    """Read the pieces of a path as fields of `PathPiece`.

    Raises:
        ConfigError: the file cannot be read, or names its line, what is wrong there, and what to write.
    """
    try:
        lines = read_text(path, limit=LONGEST_SETTINGS).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from error
    pieces = [_piece(FilePlace(str(path), number), line) for number, line in enumerate(lines, 1) if _is_piece(line)]
    if not 1 <= len(pieces) <= MOST_PIECES:
        raise ConfigError(f"{path}: {len(pieces)} pieces: give 1 to {MOST_PIECES} lines of {COLUMNS} numbers")
    turns = any(any(piece["yaw"]) for piece in pieces)
    return [piece if turns else {**piece, "yaw": []} for piece in pieces]


def _is_piece(line: str) -> bool:
    """Whether a line has numbers, and not the names of columns, or nothing."""
    return bool(line.strip()) and not line.lstrip().lower().startswith(("duration", "#"))


def _piece(place: FilePlace, line: str) -> dict[str, Any]:
    """Read one line.

    Raises:
        ConfigError: it is not 33 numbers.
    """
    cells = line.rstrip().removesuffix(",").split(",")
    if len(cells) != COLUMNS:
        fix = f"give duration, and {COEFFICIENTS} coefficients each of x, y, z and yaw, with commas between them"
        raise place.wrong(f"{len(cells)} cells, and not {COLUMNS}", fix)
    numbers = [_number(place, column, cell) for column, cell in enumerate(cells, 1)]
    axes = (numbers[first : first + COEFFICIENTS] for first in range(1, COLUMNS, COEFFICIENTS))
    return {"duration": numbers[0], **dict(zip(("x", "y", "z", "yaw"), axes, strict=True))}


def _number(place: FilePlace, column: int, cell: str) -> float:
    """Read one cell.

    Raises:
        ConfigError: it is no finite number.
    """
    try:
        number = parse_number(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise place.wrong(f"column {column}: {cell.strip()[:20]!r} is no number", "write it as 1.5 or 2e-3")
    return number
