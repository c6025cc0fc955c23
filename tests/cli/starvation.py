"""What a client is told when a loaded machine lets the simulator, the daemon or itself wait: then it asks again."""

from __future__ import annotations

from typing import Final

PATIENCE: Final = 120.0
"""Longest time to go on asking [s]; a loaded machine is slow, not wrong."""
SIGNS: Final = (
    "nobody answers",
    "no daemon at",
    "no daemon for vehicle",
    "no value for",
    "motors_unknown",
    "motors_not_known_off",
    "link_down",
    "board_unproven",
    "discovering",
    "timeout",
    "no answer",
    "did not ",
)


def is_starved(said: str, *, wanted: str = "") -> bool:
    """Whether an error may only say that something had to wait; never where a test wants just that said."""
    return not (wanted and wanted in said) and any(sign in said for sign in SIGNS)
