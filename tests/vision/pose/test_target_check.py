"""A target file that contradicts what is seen: wrong sizes and positions are said, right ones never are."""

from __future__ import annotations

import numpy as np
import pytest

from mkdaemon.config.vision import TagPlacement, TargetSection
from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.limits import LIMITS
from mkdaemon.vision.pose.projection import Projection
from mkdaemon.vision.pose.target_check import TargetCheck, misfit
from mkdaemon.vision.tags.cellread import Detection
from mkdaemon.vision.tags.tagmap import TagMap, build

LENS = Projection(Intrinsics(width=640, height=480, fx=425.0, fy=425.0, cx=319.5, cy=239.5, k1=-0.12, k2=0.02))
FACING = np.diag([1.0, -1.0, -1.0])


def pad(outer: float = 0.3048, inner: float = 0.048, x: float = 0.0) -> TagMap:
    tags = (TagPlacement(id=48, size=outer), TagPlacement(id=1, size=inner, position=(x, 0.0, 0.0)))
    return build([TargetSection(name="pad", tags=tags)], origin="test")


def seen(true: TagMap, file: TagMap, rng: np.random.Generator, *, away: float = 0.6, noise: float = 0.2):
    """What a detector finds of the true target, beside the tags as the file has them."""
    turn = rotation_from_euler(*rng.uniform(-0.6, 0.6, 3)) @ FACING
    pairs = []
    for tag, known in zip(true.targets[0].tags, file.targets[0].tags, strict=True):
        pixels, visible = LENS.project(tag.corners @ turn.T + [0.05, -0.03, away])
        assert visible.all()
        found = Detection("tag36h11", tag.tag_id, 0, 60.0, pixels + rng.normal(0.0, noise, (4, 2)))
        pairs.append((known, found))
    return pairs


@pytest.mark.parametrize("away", [0.35, 1.5, 4.0])
def test_a_right_file_is_never_contradicted(away: float) -> None:
    rng = np.random.default_rng(7)
    assert not any(misfit(seen(pad(), pad(), rng, away=away), LENS) for _ in range(40))


WRONG = [pad(0.29), pad(inner=0.06), pad(x=0.006), pad(0.6096)]


@pytest.mark.parametrize("file", WRONG, ids=range(len(WRONG)))
def test_wrong_sizes_and_positions_are_seen_but_for_sizes_wrong_by_one_factor(file: TagMap) -> None:
    rng = np.random.default_rng(8)
    assert sum(misfit(seen(pad(), file, rng), LENS) is True for _ in range(40)) > 38
    assert misfit(seen(pad(), pad(0.1524, 0.024), rng), LENS) is False


def test_one_tag_alone_says_nothing_and_far_ones_are_left_alone() -> None:
    pairs = seen(pad(), pad(), np.random.default_rng(1))
    assert misfit(pairs[:1], LENS) is None
    row = (TagPlacement(id=1, size=0.05), TagPlacement(id=2, size=0.05, position=(1, 0, 0)))
    tags = build([TargetSection(name="row", tags=row)], origin="test").targets[0].tags
    assert misfit([(tag, found) for tag, (_, found) in zip(tags, pairs, strict=True)], LENS) is None


def test_it_is_said_after_some_images_and_taken_back_by_one_that_fits() -> None:
    rng, wrong, right, said = np.random.default_rng(2), pad(0.25), pad(), []
    check = TargetCheck(wrong, LENS)
    fitting = [found for _, found in seen(wrong, wrong, rng)]
    images = [[found for _, found in seen(right, wrong, rng)] for _ in range(LIMITS.health.misfit_images)]
    # one tag alone agrees with any file
    for detections in (*images, images[0][:1], fitting):
        check.look(detections)
        said.append(check.contradicted)
    assert said == [()] * (LIMITS.health.misfit_images - 1) + [("pad",), ("pad",), ()]


def test_without_a_calibration_nothing_is_judged() -> None:
    check = TargetCheck(pad(0.25), None)
    for _ in range(3 * LIMITS.health.misfit_images):
        check.look([found for _, found in seen(pad(), pad(), np.random.default_rng(3))])
    assert check.contradicted == ()
