"""Refusal and warning if the barometer contradicts the heights of the cameras. Pure.

The comparison is the cameras' own (`vision/<camera>/stats`, docs/vision.md, "Self-calibration").
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.vision import VisionStats

LEAST_WAY: Final = 0.5
"""Less up or down says nothing [m]: ten steps of a barometer."""


class HeightsFound(NamedTuple):
    """The comparison that contradicts the most.

    Attributes:
        odds: decimal logarithm of the odds that the heights are wrong, against right ones.
        words: the scale of the heights, in words.
        refusal: what is wrong then, and what to do.
    """

    odds: float
    words: str
    refusal: CommandRejectedError


def heights_found(eyes: Iterable[VisionStats]) -> HeightsFound | None:
    """Return what the barometer says of the heights; None where nothing was compared.

    Args:
        eyes: what each camera last said of itself.
    """
    compared = [(stats, each) for stats in eyes for each in stats.selfcal if each.height_covered > LEAST_WAY]
    if not compared:
        return None
    stats, most = max(compared, key=lambda pair: pair[1].height_odds)
    way, share, sd = most.height_covered, most.height_percent / 100.0, most.height_sd_percent / 100.0
    refusal = refuse(
        Token.HEIGHTS_CONTRADICTED,
        camera=stats.camera,
        target=most.target,
        way=way,
        by=way * (1.0 - share),
        sd=way * sd,
        share=100.0 * share,
    )
    words = f"a way of {way:.2f} m is {way * (1.0 - share):.2f} +- {way * sd:.2f} m by the barometer"
    return HeightsFound(most.height_odds, words, refusal)
