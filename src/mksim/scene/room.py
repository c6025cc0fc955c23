"""A room to fly through: two pads 6 m apart, and 24 tags on the floor between them, as they lie and as surveyed."""

from __future__ import annotations

from typing import Final

import numpy as np

from mkdaemon.config.vision import PlaceSection, TagPlacement, TargetSection
from mkdaemon.vision.tags.tagmap import TagMap, build
from mksim.scene.nested import NESTED

START, GOAL = "pad-a", "pad-b"
"""Names of the pads; the map has its origin in the middle of the second."""
AWAY: Final = 6.0
"""From one pad to the other [m]: the first lies west of the second."""
FLOOR_SIDE: Final = 0.2
"""Of the tags on the floor [m]."""
ROWS, COLUMNS = 3, 8
FIRST_ID: Final = 200
PAD_IDS: Final = {START: (112, 2), GOAL: tuple(tag.id for tag in NESTED.tags)}
"""Codes of the pads, whose tags are those of configs/targets/nested-36.toml and nested.toml."""
PAD_SIDES: Final = {START: (0.3048, 0.036), GOAL: tuple(tag.size for tag in NESTED.tags)}
PLACE_SD: Final = 0.001
"""Deviation of a surveyed place along each axis [m]: what surveys left was less; docs/lab/cameras.md."""
TURN_SD: Final = 0.1
"""The same of a turn about each axis [deg]."""


def room_map(survey: int | None = None) -> TagMap:
    """The room as one target.

    Args:
        survey: seed of the errors that a survey left; None for the room as it is.
    """
    rng = np.random.default_rng([59, survey or 0])
    laid = np.random.default_rng(59)
    tags: list[TagPlacement] = []

    def lay(codes: tuple[int, ...], sizes: tuple[float, ...], east: float, north: float, yaw_deg: float) -> None:
        off, turned = rng.normal(0.0, PLACE_SD, 3), rng.normal(0.0, TURN_SD, 3)
        known = survey is not None
        for code, size in zip(codes, sizes, strict=True):
            tags.append(
                TagPlacement(
                    id=code,
                    size=size,
                    position=tuple((np.array([east, north, 0.0]) + known * off).tolist()),
                    rpy_deg=tuple((np.array([0.0, 0.0, yaw_deg]) + known * turned).tolist()),
                    position_sd=(PLACE_SD,) * 3 if known else (0.0,) * 3,
                    turn_sd_deg=(TURN_SD,) * 3 if known else (0.0,) * 3,
                )
            )

    lay(PAD_IDS[GOAL], PAD_SIDES[GOAL], 0.0, 0.0, 0.0)
    lay(PAD_IDS[START], PAD_SIDES[START], -AWAY, 0.0, 0.0)
    for code in range(ROWS * COLUMNS):
        column, row = code % COLUMNS + 1, code // COLUMNS - (ROWS - 1) / 2
        east, north = -AWAY * column / (COLUMNS + 1), 0.7 * row
        about, yaw = laid.normal(0.0, 0.05, 2), laid.uniform(-180.0, 180.0)
        lay((FIRST_ID + code,), (FLOOR_SIDE,), east + float(about[0]), north + float(about[1]), yaw)
    places = tuple(PlaceSection(name=name, tag=codes[0]) for name, codes in PAD_IDS.items())
    section = TargetSection(name="room", tags=tuple(tags), places=places)
    return build([section], origin="built-in room")
