"""What following a target may take of an image's time."""

from __future__ import annotations

import numpy as np
import pytest

from lab.vision.flight import LOOKING_DOWN
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.detector import TONES
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.follower import LARGE_PX, MOST_EFFORT
from mkdaemon.vision.track.tracker import Tracker
from tests.vision.views import VGA, View, place, shipped


class Blind:
    """A detector that finds nothing until it is told to, and remembers what was asked."""

    def __init__(self) -> None:
        self.looks: list[tuple[str, int]] = []
        self.found: list[Detection] = []

    def search(self, _pixels, view, _window, decimate):
        self.looks.append((view, decimate))
        return self.found


@pytest.mark.parametrize(("side", "decimate"), [(LARGE_PX - 1, 1), (LARGE_PX, 2)])
def test_a_target_is_decoded_again_one_way_at_a_time_and_large_ones_at_half_the_resolution(side, decimate):
    target, blind = shipped("single"), Blind()
    (follower,) = Tracker(TagMap((target,)), VGA, LOOKING_DOWN).followers
    follower._detector = blind
    for _ in range(LIMITS.search.beside_every * len(TONES)):
        follower._search_again(np.zeros((480, 640), np.uint8), (0, 0, side, 400))
    looks = [(tone, decimate) for tone in TONES]
    assert blind.looks == looks
    (tag,) = target.tags
    blind.found = [Detection(*tag.code, 0, 50.0, np.zeros((4, 2)))]
    for _ in range(2):
        follower._search_again(np.zeros((480, 640), np.uint8), (0, 0, side, 400))
    assert blind.looks[len(looks) :] == looks[:1] * 2, "what finds it stays"


def test_a_target_that_is_gone_costs_an_image_a_bounded_number_of_fits():
    target = shipped("single")
    view = View(target, place(2.0, 0.2))
    tracker = Tracker(TagMap((target,)), VGA, LOOKING_DOWN)
    (follower,) = tracker.followers
    for k in range(2):
        pixels = view.pixels.copy()
        pixels[0, 0] ^= k
        assert tracker.update(CameraImage(pixels, k / 30, k / 30, k, "down")).poses
    gone = np.roll(view.pixels, 60, axis=1)[::-1].copy()
    for k in range(2, 5):
        gone[0, 0] ^= 1
        assert not tracker.update(CameraImage(gone, k / 30, k / 30, k, "down")).poses
        # of the start that spends the last of it every fit is made
        assert follower._fitter.effort <= 2 * MOST_EFFORT
