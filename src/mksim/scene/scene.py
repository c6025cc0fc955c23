"""The landing scene: flat prints on a textured ground, seen by a moving camera.

Each print is carried into the image by inverting the exact projection for every sample, so distortion, perspective
and anti-aliasing need no intermediate image. How an edge stays where it belongs is described in `layers`; the
independent truth is `scene_view.project`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.intrinsics import Intrinsics
from mkdaemon.vision.tags.tagmap import Target
from mksim.scene.curl import bend
from mksim.scene.gloss import add_gloss
from mksim.scene.ground import Ground, GroundKind
from mksim.scene.layers import Layer, print_target
from mksim.scene.lensfaults import add_dirt, add_fringe
from mksim.scene.light import Conditions, Sensor, add_glare, lens_blur, shade, streak
from mksim.scene.raster import draw_covers, draw_layer, polygon_mask, ray_from_plane, visible_layers
from mksim.scene.rolling import roll
from mksim.scene.shadows import shade_leaves, shade_vehicle
from mksim.scene.view import NEAR_M, CameraView, Pose, RayGrid, project

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

FINE_SAMPLES = 5_000_000
"""Most sub-samples a print may take in a still for measurements."""
LIVE_SAMPLES = 330_000
"""Most sub-samples a print may take in real time: one per pixel of 640 x 480."""
NEUTRAL = 0.45
"""Reflectance of the ground where none is drawn."""


class Motion(Protocol):
    """How a target moves."""

    def pose_at(self, time: float) -> Pose:
        """Pose of the target in the world at `time` [s]."""


@dataclass(frozen=True, eq=False)
class SceneTarget:
    """A target of the map in the world.

    Attributes:
        target: its tags.
        layers: what was printed.
        motion: where it is.
    """

    target: Target
    layers: tuple[Layer, ...]
    motion: Motion

    @classmethod
    def of(cls, target: Target, motion: Motion) -> SceneTarget:
        """Print every tag of `target` and put it on `motion`."""
        return cls(target, print_target(target), motion)


class Scene:
    """Ground, targets and a sensor; equal seeds and calls give equal bytes.

    Args:
        targets: what stands in the scene; conditions refer to the first.
        ground: kind of ground, a ground several scenes share, or none for grey.
        seed: of ground texture and noise.
        fine: spend up to five million samples a print instead of real time.
    """

    def __init__(
        self,
        targets: Sequence[SceneTarget],
        *,
        ground: GroundKind | Ground | None = "asphalt",
        seed: int = 0,
        fine: bool = True,
    ) -> None:
        self.targets = tuple(targets)
        self._ground = Ground(ground, seed) if isinstance(ground, str) else ground
        self._sensor = Sensor(seed)
        self._spread_px = 1.0 if fine else 4.0
        self._budget = FINE_SAMPLES if fine else LIVE_SAMPLES
        self._rays: dict[Intrinsics, RayGrid] = {}

    def render(self, view: CameraView, conditions: Conditions | None = None) -> npt.NDArray[np.uint8]:
        """Expose one image.

        Args:
            view: camera at the middle of its exposure.
            conditions: light, lens, sensor; the default is a good day.

        Returns:
            `(height, width)` uint8 of `view.intrinsics`.
        """
        conditions = conditions or Conditions()
        rays = self._rays.get(view.intrinsics)
        if rays is None:
            rays = self._rays.setdefault(view.intrinsics, RayGrid(view.intrinsics))
        if view.line_time > 0.0 and self.targets:
            rays = roll(rays, view, self.targets[0].motion.pose_at(view.time))
        if conditions.curl is not None and self.targets:
            rays = bend(rays, view, self.targets[0].motion.pose_at(view.time), conditions.curl)
        light = lens_blur(self._exposed(view, conditions, rays), conditions)
        if conditions.fringe_px > 0.0:
            light = add_fringe(light, conditions.fringe_px)
        if conditions.dirt is not None:
            light = add_dirt(light, conditions.dirt)
        return self._sensor.expose(light, conditions)

    def _exposed(self, view: CameraView, conditions: Conditions, rays: RayGrid) -> Image32:
        """Light on the sensor over the exposure.

        What all parts of the image share of the motion is one streak; what they do not share (turning, climbing) is
        followed by sub-exposures, each with its part of the streak.
        """
        flow = self._flow(view, rays)
        shared = flow.mean(axis=0)
        spread = float(np.linalg.norm(flow - shared, axis=1).max())
        count = int(np.clip(np.ceil(spread / self._spread_px), 1, 6))
        light = np.zeros(rays.x.shape, dtype=np.float32)
        for along in (np.arange(count) + 0.5) / count - 0.5:
            light += self._lit(view.moved(float(along) * view.exposure_time), conditions, rays)
        light *= np.float32(1.0 / count)
        if float(np.linalg.norm(shared)) < 0.2 * count:
            return light
        kernel = streak(shared / count)
        return np.asarray(cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)

    def _flow(self, view: CameraView, rays: RayGrid) -> Array:
        """Motion of middle and corners over the exposure, at the first target's depth `(5, 2)` [px]."""
        if view.exposure_time <= 0.0:
            return np.zeros((1, 2))
        height, width = rays.x.shape
        at = ([0, 0, -1, -1, height // 2], [0, -1, 0, -1, width // 2])
        looks = np.stack([rays.x[at], rays.y[at], np.ones(5)], axis=1).astype(np.float64)
        if self.targets:
            origin = self.targets[0].motion.pose_at(view.time).position_enu
            depth = float(view.camera_points(origin[None])[0, 2])
        else:
            depth = float(view.position_enu[2])
        points = view.position_enu + (looks * max(depth, 0.05)) @ view.enu_from_cam.T
        ends = []
        for offset in (-0.5 * view.exposure_time, 0.5 * view.exposure_time):
            moved = view.moved(offset)
            carried = points
            if self.targets:
                motion = self.targets[0].motion
                before, after = motion.pose_at(view.time), motion.pose_at(moved.time)
                carried = after.points((points - before.position_enu) @ before.enu_from_body)
            ends.append(project(moved.camera_points(carried), view.intrinsics))
        flow: Array = np.nan_to_num(ends[1] - ends[0])
        return flow

    def _lit(self, view: CameraView, conditions: Conditions, rays: RayGrid) -> Image32:
        """Reflected light of a standing scene seen by a standing camera, before the lens."""
        layers = [
            seen
            for target in self.targets
            if conditions.target_in_view
            for seen in visible_layers(target.layers, target.motion.pose_at(view.time), view, rays)
        ]
        # What a print hides completely need not be drawn.
        first = max((k for k, seen in enumerate(layers) if seen.fills_image), default=None)
        if first is not None or self._ground is None:
            image = np.full(rays.x.shape, NEUTRAL, dtype=np.float32)
        else:
            image = self._ground.render(view, rays)
        for seen in layers[first or 0 :]:
            draw_layer(image, seen, rays, self._budget)
        if not self.targets:
            return image
        pose = self.targets[0].motion.pose_at(view.time)
        if conditions.target_in_view:
            draw_covers(image, conditions.covers, pose, view)
        plane_from_ray = np.asarray(np.linalg.inv(ray_from_plane(pose, view)), dtype=np.float64)
        if conditions.shadow is not None:
            shade(image, conditions.shadow, rays, plane_from_ray)
        if conditions.leaves is not None:
            shade_leaves(image, conditions.leaves, rays, plane_from_ray)
        if conditions.vehicle is not None:
            shade_vehicle(image, conditions.vehicle, rays, plane_from_ray)
        if conditions.gloss is not None and conditions.target_in_view:
            print_mask = polygon_mask([self.targets[0].layers[0].outline(8)], pose, view)
            add_gloss(image, print_mask, conditions.gloss, rays, view.enu_from_cam.T @ pose.enu_from_body)
        for glare in conditions.glare:
            point = np.array([[*glare.point, 0.0], [glare.point[0] + glare.radius, glare.point[1], 0.0]])
            spot = project(view.camera_points(pose.points(point)), view.intrinsics)
            add_glare(image, glare, spot[0], float(np.linalg.norm(spot[1] - spot[0])))
        return image


def true_corners(target: SceneTarget, view: CameraView) -> dict[tuple[str, int], Array]:
    """Exact image corners of every tag of a target that faces the camera.

    Returns:
        By (family, id): `(4, 2)` [px, centres at integers], TL, TR, BR, BL of the print; NaN rows for corners behind
        the lens.
    """
    pose = target.motion.pose_at(view.time)
    seen: dict[tuple[str, int], Array] = {}
    for tag in target.target.tags:
        normal = pose.enu_from_body @ tag.rotation[:, 2]
        if float((view.position_enu - pose.points(tag.position[None])[0]) @ normal) > NEAR_M:
            corners = project(view.camera_points(pose.points(tag.corners)), view.intrinsics)
            seen[tag.family.name, tag.tag_id] = corners
    return seen


def cam_from_target(target: SceneTarget, view: CameraView) -> tuple[Array, Array]:
    """True pose of a target in the camera frame: rotation `(3, 3)`, translation `(3,)` [m; RDF]."""
    pose = target.motion.pose_at(view.time)
    return view.enu_from_cam.T @ pose.enu_from_body, view.camera_points(pose.position_enu[None])[0]
