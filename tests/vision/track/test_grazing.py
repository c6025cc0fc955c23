"""A target seen so flat that its cells show neither edges nor grey values."""

from __future__ import annotations

import numpy as np

from lab.vision.flight import VGA
from lab.vision.stills import Studio, error_of, look_once, target_named
from mkdaemon.config.vision import TrackerSection
from mkdaemon.telemetry.vision import PoseRefusal
from mkdaemon.vision.pose.gates import fit_refusal
from mkdaemon.vision.pose.pose import Pose


def test_four_corners_alone_are_no_fit() -> None:
    corners = Pose(np.eye(3), np.array([0.0, 0.0, 2.0]), 1e-8 * np.eye(6), "corners", 4, 0.05)
    assert fit_refusal(corners, TrackerSection()) is PoseRefusal.NO_FIT


def test_nothing_wrong_is_published_from_84_degrees() -> None:
    """Corners there were off by 6 to 9 cm and claimed 0.3 cm: 5 of 60 images near the border of the image."""
    target = target_named("single")
    studio, seen = Studio(target, 3_000_300, fine=False, part=84), 0
    for _ in range(5):
        still = studio.shoot(2.0, float(np.radians(84.0)), off=0.3)
        found = look_once(still, target, VGA, with_attitude=True).pose_of(target.name)
        if found is None:
            continue
        seen += 1
        assert found.pose.source != "corners"
        assert error_of(found.pose.rotation, found.pose.position, still.rotation, still.position).distance < 0.05
    assert seen > 1
