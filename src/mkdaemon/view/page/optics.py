"""Where a camera looks: its frustum over the target, and the tags of a target in its image.

Camera axes are right, down, forward; a target has z out of the paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from mkdaemon.frames import rotation_from_quaternion
from mkdaemon.telemetry.vision import CameraSetup, LensShape, TargetShape, VisionPose

Array = npt.NDArray[np.float64]

ROUNDS: Final = 12
"""Of the iteration that takes distortion away; a barrel of -0.2 is exact to 1e-4 after six."""
STEPS: Final = 4
"""Parts of an edge of the image: a lens bends it."""
FARTHEST: Final = 8.0
"""Drawn length of a ray that does not meet the target's plane [m]."""
NEAR: Final = 0.05
"""A point nearer than this to the camera's plane is in no image [m]."""


def frustum(setup: CameraSetup, position: Array, rotation: Array, depth: float) -> dict[str, object] | None:
    """A camera's field of view, in the frame the vehicle is given in; None where lens or mount is not known.

    Args:
        setup: lens and mount.
        position: of the vehicle (3,) [m].
        rotation: of the vehicle (3, 3).
        depth: of the plane on which the image is drawn [m].

    Returns:
        `apex` (3,), `image` the corners of that plane from the top left clockwise (4, 3), and `ground`, where the edge
        of the image meets the plane z = 0 (n, 3) [m].
    """
    lens, mount, turn = setup.lens, setup.position_flu, setup.quaternion_flu_from_cam
    if lens is None or mount is None or turn is None:
        return None
    world_from_cam = rotation @ rotation_from_quaternion(turn)
    apex = position + rotation @ np.array(mount)
    edge = _edge_rays(lens) @ world_from_cam.T
    corners = edge[:: len(edge) // 4]
    ground = apex + edge * _reach(edge[:, 2], float(apex[2]))[:, None]
    return {"apex": _listed(apex), "image": _listed(apex + corners * depth), "ground": _listed(ground)}


def project(setup: CameraSetup, pose: VisionPose) -> list[list[list[float]]]:
    """Outlines of a target's tags where its pose puts them in the image: corners (4, 2) of each [px].

    Args:
        setup: lens, and the shapes of the targets.
        pose: of the target before the camera.
    """
    shapes = [target for target in setup.targets if target.name == pose.target]
    if setup.lens is None or not shapes:
        return []
    rotation, origin = rotation_from_quaternion(pose.quaternion_cam_from_target), np.array(pose.position_cam)
    return [
        _listed(_pixels(setup.lens, seen))
        for tag in shapes[0].tags
        for seen in [np.array(tag.corners) @ rotation.T + origin]
        if float(seen[:, 2].min()) > NEAR
    ]


def shape_of(targets: Sequence[TargetShape], name: str) -> list[dict[str, object]]:
    """The tags of a target for drawing; empty where it is not known."""
    found = next((target for target in targets if target.name == name), None)
    return [] if found is None else [{"id": tag.id, "corners": tag.corners, "cells": tag.cells} for tag in found.tags]


def _edge_rays(lens: LensShape) -> Array:
    """Directions (4 * STEPS, 3) of depth 1 around the image, from the top left corner clockwise."""
    right, bottom = lens.width - 0.5, lens.height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    share = np.linspace(0.0, 1.0, STEPS, endpoint=False)[:, None]
    ends = np.roll(corners, -1, 0)
    pixels = np.concatenate([start + (end - start) * share for start, end in zip(corners, ends, strict=True)])
    bent = (pixels - [lens.cx, lens.cy]) / [lens.fx, lens.fy]
    straight = bent.copy()
    for _ in range(ROUNDS):
        straight += bent - _bend(lens, straight)
    return np.column_stack([straight, np.ones(len(straight))])


def _bend(lens: LensShape, plane: Array) -> Array:
    """Distort points (n, 2) of the plane at depth 1, as OpenCV's models do."""
    # fisheye: r' = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8), a = atan r (Kannala and Brandt, IEEE TPAMI 28(8), 2006);
    # else x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + tangential terms p1, p2 (Brown, Photogrammetric Eng. 37(8), 1971).
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    if lens.model == "fisheye":
        k1, k2, k3, k4 = lens.distortion
        radius = np.sqrt(np.maximum(r2, 1e-18))
        angle = np.arctan(radius)
        a2 = angle * angle
        bent: Array = plane * (angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))) / radius)[:, None]
        return bent
    k1, k2, p1, p2, k3 = lens.distortion
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    shift = np.column_stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y])
    turned: Array = plane * radial[:, None] + shift
    return turned


def _pixels(lens: LensShape, seen: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) before the camera."""
    found: Array = _bend(lens, seen[:, :2] / seen[:, 2:]) * [lens.fx, lens.fy] + [lens.cx, lens.cy]
    return found


def _reach(falls: Array, height: float) -> Array:
    """How long rays (n,) of vertical parts `falls` are until they meet z = 0, at most `FARTHEST`."""
    with np.errstate(divide="ignore"):
        lengths = np.where(falls < -1e-6, height / np.maximum(-falls, 1e-6), math.inf)
    found: Array = np.clip(lengths, 0.0, FARTHEST)
    return found


def _listed(points: Array) -> list[list[float]]:
    """Plain numbers, to a tenth of a millimetre."""
    found: list[list[float]] = np.round(points, 4).tolist()
    return found
