"""A room to fly through: two pads 6 m apart, and 24 tags on the floor between them, as they lie and as surveyed.

In the middle of it a figure of eight is flown.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from mkdaemon.config.vision import PlaceSection, TagPlacement, TargetSection
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest
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
LAP: Final = 6.097
"""Length of the figure of eight [m]."""
POINTS: Final = 16
"""Of a lap."""
RUN_UP: Final = (3.0, 1.8, 1.4, 1.15)
"""Factors on the times of its first legs, and of the last, backwards."""


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


def figure_of_eight(speed: float, laps: int, height: float) -> PathUploadRequest:
    """A figure of eight of 2 x 1 m in the middle of the room, from the middle of the pad `GOAL`.

    It is the lemniscate of Gerono, x = sin w t and y = sin(2 w t) / 2.

    Args:
        speed: mean [m/s]; 1.46 of it in the middle. The bends need 2.3 / m of its square.
        laps: how often.
        height: above the pad [m].
    """
    points, legs = [PathPoint(position=(-0.5 * AWAY, 0.0, height))], laps * POINTS
    for leg in range(legs):
        edge, turn = min(leg, legs - 1 - leg), math.tau * (leg + 1) / POINTS
        slow = RUN_UP[edge] if edge < len(RUN_UP) else 1.0
        place = (-0.5 * AWAY + math.sin(turn), 0.5 * math.sin(2.0 * turn), height)
        points.append(PathPoint(position=place, time=slow * LAP / (POINTS * speed)))
    return PathUploadRequest(points=tuple(points))
