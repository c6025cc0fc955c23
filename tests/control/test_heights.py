"""What the barometer says of the heights that cameras show, in words."""

from __future__ import annotations

import pytest

from mkdaemon.control.heights import heights_found
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.telemetry.vision import VisionStats


def eye(camera, *compared):
    """A camera that compared the heights over some targets."""
    return VisionStats.model_construct(camera=camera, selfcal=tuple(compared))


def over(target, *, odds=1.0, covered=4.0, percent=10.0, sd=2.5):
    return SelfCalibration.model_construct(
        target=target, height_odds=odds, height_covered=covered, height_percent=percent, height_sd_percent=sd
    )


def test_the_comparison_that_contradicts_the_most_is_warned_with_its_scale():
    eyes = [eye("down", over("pad"), over("box", odds=3.0)), eye("forward", over("pad", odds=2.0))]
    found = heights_found(eyes)
    assert (found.odds, found.words) == (3.0, "a way of 4.00 m is 3.60 +- 0.10 m by the barometer")
    assert found.refusal.token == "heights_contradicted"
    told = "camera down over box measured a climb or descent of 4.00 m, the barometer 3.60 +- 0.10 m"
    assert told in found.refusal.reason
    assert "an error of +10 %" in found.refusal.reason


@pytest.mark.parametrize(
    ("eyes", "is_warned"),
    [
        ([], False),
        ([eye("down")], False),
        ([eye("down", over("pad", covered=0.5, odds=5.0)), eye("forward")], False),
        ([eye("down", over("pad", covered=0.51, odds=5.0)), eye("forward")], True),
    ],
)
def test_half_a_metre_up_and_down_says_nothing_yet(eyes, is_warned):
    assert (heights_found(eyes) is not None) is is_warned
