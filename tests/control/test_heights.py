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


def test_a_way_by_the_camera_is_warned_with_what_it_is_by_the_barometer():
    found = heights_found([eye("down", over("pad"))])
    assert found.odds == 1.0
    assert found.words == "a way of 4.00 m is 3.60 +- 0.10 m by the barometer"
    assert found.refusal.token == "heights_contradicted"
    assert (
        "camera down over pad measured a climb or descent of 4.00 m, the barometer 3.60 +- 0.10 m"
        in found.refusal.reason
    )
    assert "an error of +10 %" in found.refusal.reason


def test_the_comparison_that_contradicts_the_most_is_warned():
    eyes = [eye("down", over("pad"), over("box", odds=3.0)), eye("forward", over("pad", odds=2.0))]
    found = heights_found(eyes)
    assert found.odds == 3.0
    assert "camera down over box" in found.refusal.reason


@pytest.mark.parametrize(("covered", "is_warned"), [(0.5, False), (0.51, True)])
def test_half_a_metre_up_and_down_says_nothing_yet(covered, is_warned):
    found = heights_found([eye("down", over("pad", covered=covered, odds=5.0)), eye("forward")])
    assert (found is not None) is is_warned


def test_where_nothing_was_compared_nothing_is_found():
    assert heights_found([]) is None
    assert heights_found([eye("down")]) is None
