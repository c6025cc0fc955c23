"""An artificial horizon in letters. Pure."""

from __future__ import annotations

import math
from typing import Final

DEGREES_A_ROW: Final = 6.0
"""Scale: pitch of one row [deg]."""
ROW_OF_COLUMNS: Final = 2.0
"""A letter is about twice as high as wide."""
FLAT: Final = math.radians(20.0)
"""Up to this roll the line is drawn by `-` [rad]."""
SKY, GROUND = " ", ":"


def horizon(roll: float, pitch: float, columns: int, rows: int) -> list[str]:
    """Draw what a pilot sees: sky is blank, ground `:`, and between them a line.

    Args:
        roll: right side down positive [rad]: the right end of the line is higher then.
        pitch: nose down positive [rad]: the line moves up.
        columns: width, odd.
        rows: height, odd.

    Returns:
        Rows from the top; `==o==` in the middle is the aircraft.
    """
    edge = "-" if abs(math.remainder(roll, math.pi)) < FLAT else "/" if math.tan(roll) > 0 else "\\"
    found = []
    for row in range(rows):
        up = rows // 2 - row
        letters = []
        for column in range(columns):
            right = (column - columns // 2) / ROW_OF_COLUMNS
            over = (up * math.cos(roll) - right * math.sin(roll)) - math.degrees(pitch) / DEGREES_A_ROW
            letters.append(edge if abs(over) <= 0.5 else SKY if over > 0 else GROUND)
        found.append("".join(letters))
    middle, place = rows // 2, columns // 2 - 2
    found[middle] = f"{found[middle][:place]}==o=={found[middle][place + 5 :]}"
    return found
