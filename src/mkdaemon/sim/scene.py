"""The landing scene: flat prints on a textured ground, seen by a moving camera.

Each print is carried into the image by inverting the exact projection for every sample, so distortion, perspective and anti-aliasing need no
intermediate image. How an edge stays where it belongs is told in `scene_print`; the independent truth is `scene_view.project`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.sim.scene_ground import Ground, GroundKind
from mkdaemon.sim.scene_light import Conditions, Cover, Sensor, add_glare, lens_blur, shade, streak
from mkdaemon.sim.scene_print import PAD, PAPER, Layer, print_target
from mkdaemon.sim.scene_view import NEAR_M, CameraView, Pose, RayGrid, project
from mkdaemon.vision.intrinsics import Intrinsics
from mkdaemon.vision.tagmap import Target

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

FINE_SAMPLES = 5_000_000
"""Most sub-samples a print may take in a still for measurements."""
LIVE_SAMPLES = 330_000
"""Most sub-samples a print may take in real time: one per pixel of 640 x 480."""
FAR_PX = 1e6


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
        ground: kind of ground, or none for grey.
        seed: of ground texture and noise.
        fine: spend up to five million samples a print instead of real time.
    """

    def __init__(
        self, targets: Sequence[SceneTarget], *, ground: GroundKind | None = "asphalt", seed: int = 0, fine: bool = True
    ) -> None:
        self.targets = tuple(targets)
        self._ground = Ground(ground, seed) if ground is not None else None
        self._sensor = Sensor(seed)
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
        return self._sensor.expose(lens_blur(self._exposed(view, conditions, rays), conditions), conditions)

    def _exposed(self, view: CameraView, conditions: Conditions, rays: RayGrid) -> Image32:
        """Light on the sensor, integrated over the exposure: a streak where all parts move alike, sub-exposures where not."""
        still = view.moved(0.0)
        flow = self._flow(view)
        spread = float(np.linalg.norm(flow - flow.mean(axis=0), axis=1).max())
        longest = float(np.linalg.norm(flow, axis=1).max())
        if longest < 0.2:
            return self._lit(still, conditions, rays)
        if spread < 0.5:
            return np.asarray(
                cv2.filter2D(
                    self._lit(still, conditions, rays), -1, streak(flow.mean(axis=0)), borderType=cv2.BORDER_REPLICATE
                ),
                dtype=np.float32,
            )
        count = int(np.clip(np.ceil(longest), 2, 32))
        total = np.zeros(rays.x.shape, dtype=np.float32)
        for along in (np.arange(count) + 0.5) / count - 0.5:
            total += self._lit(view.moved(float(along) * view.exposure_s), conditions, rays)
        total /= count
        return total

    def _flow(self, view: CameraView) -> Array:
        """Image motion of the first target's corners (else of the ground ahead) over the exposure `(n, 2)` [px]."""
        if view.exposure_s <= 0.0:
            return np.zeros((1, 2))
        ends = []
        for along in (-0.5, 0.5):
            at = view.moved(along * view.exposure_s)
            if self.targets:
                first = self.targets[0]
                points = first.motion.pose_at(at.time).points(first.layers[0].outline())
            else:
                reach = max(view.position_enu[2], 0.1)
                points = view.position_enu + (
                    np.array([[0.0, 0.0, reach], [0.2 * reach, 0.0, reach]]) @ view.enu_from_cam.T
                )
            ends.append(project(at.camera_points(points), view.intrinsics))
        flow = ends[1] - ends[0]
        good: Array = flow[np.isfinite(flow).all(axis=1)]
        return good if good.size else np.zeros((1, 2))

    def _lit(self, view: CameraView, conditions: Conditions, rays: RayGrid) -> Image32:
        """Reflected light of a standing scene seen by a standing camera, before the lens."""
        image = self._background(view, conditions, rays)
        if conditions.target_in_view:
            for target in self.targets:
                self._draw_target(image, target, view, rays)
        if not self.targets:
            return image
        pose = self.targets[0].motion.pose_at(view.time)
        for cover in conditions.covers if conditions.target_in_view else ():
            _draw_cover(image, cover, pose, view)
        if conditions.shadow is not None:
            shade(image, conditions.shadow, rays, np.linalg.inv(_ray_from_plane(pose, view)))
        for glare in conditions.glare:
            point = np.array([[*glare.point, 0.0], [glare.point[0] + glare.radius, glare.point[1], 0.0]])
            seen = project(view.camera_points(pose.points(point)), view.intrinsics)
            add_glare(image, glare, seen[0], float(np.linalg.norm(seen[1] - seen[0])))
        return image

    def _background(self, view: CameraView, conditions: Conditions, rays: RayGrid) -> Image32:
        """The ground, unless a print hides all of it."""
        hidden = conditions.target_in_view and any(
            _fills_image(matrix, layer.cells.shape, rays)
            for target in self.targets
            for layer, matrix, _ in _visible_layers(target, view, rays)
        )
        if self._ground is None or hidden:
            return np.full(rays.x.shape, 0.45, dtype=np.float32)
        return self._ground.render(view, rays)

    def _draw_target(self, image: Image32, target: SceneTarget, view: CameraView, rays: RayGrid) -> None:
        """Composite a target's layers over `image` in place."""
        for layer, cells_from_ray, window in _visible_layers(target, view, rays):
            self._draw_layer(image, layer, cells_from_ray, rays, window)

    def _draw_layer(
        self, image: Image32, layer: Layer, cells_from_ray: Array, rays: RayGrid, window: tuple[slice, slice]
    ) -> None:
        rows, columns = window
        x, y = rays.x[rows, columns], rays.y[rows, columns]
        widest, narrowest = _cell_sizes(cells_from_ray, x, y, rays.intrinsics.fx, layer.cells.shape)
        if widest <= 0.0:
            return
        allowed = max(int(np.sqrt(self._budget / x.size)), 1)
        factor = int(np.clip(np.ceil(0.8 * widest / narrowest), min(2, allowed), min(6, allowed)))
        density = layer.texels_per_cell(max(narrowest * factor, widest / 1.5))
        u, v = _texel_map(cells_from_ray, density, *rays.fine(rows, columns, factor))
        sampled = cv2.remap(layer.texture(density), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        if factor > 1:
            sampled = cv2.resize(sampled, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
        reflected, covered = cv2.split(sampled)
        part = image[rows, columns]
        np.subtract(np.float32(1.0), covered, out=covered)
        part *= covered
        part += reflected


def _visible_layers(
    target: SceneTarget, view: CameraView, rays: RayGrid
) -> list[tuple[Layer, Array, tuple[slice, slice]]]:
    """Layers that can be seen, from the back, each with its homography from rays to cells and its window."""
    pose = target.motion.pose_at(view.time)
    found: list[tuple[Layer, Array, tuple[slice, slice]]] = []
    for layer in target.layers:
        body = Pose(pose.enu_from_body @ layer.rotation, pose.points(layer.position[None])[0])
        if float((view.position_enu - body.position_enu) @ body.enu_from_body[:, 2]) <= NEAR_M:
            continue
        outline = _clip_near(view.camera_points(pose.points(layer.outline(8))))
        if len(outline) < 3:
            continue
        flat = outline[:, :2] / outline[:, 2:]
        low, high = flat.min(axis=0), flat.max(axis=0)
        rows, columns = rays.window((low[0], high[0]), (low[1], high[1]))
        if rows.stop <= rows.start or columns.stop <= columns.start:
            continue
        cells_from_ray = layer.cells_from_plane() @ np.linalg.inv(_ray_from_plane(body, view))
        if _fills_image(cells_from_ray, layer.cells.shape, rays):
            found.clear()
        found.append((layer, cells_from_ray, (rows, columns)))
    return found


def _fills_image(cells_from_ray: Array, shape: tuple[int, ...], rays: RayGrid) -> bool:
    """Whether the rim of the image, and so all of it, lies inside the layer."""
    u, v, w = cells_from_ray @ rays.rim
    return bool(
        (w > 1e-6).all() and (u > 0).all() and (v > 0).all() and (u < shape[1] * w).all() and (v < shape[0] * w).all()
    )


def _texel_map(cells_from_ray: Array, density: float, x: Image32, y: Image32) -> tuple[Image32, Image32]:
    """Where in a padded texture each ray lands; rays that miss the plane land on the clear rim."""
    m = (np.diag([density, density, 1.0]) @ cells_from_ray).astype(np.float32)
    depth = m[2, 0] * x
    depth += m[2, 1] * y
    depth += m[2, 2]
    misses = depth <= np.float32(1e-6) if float(depth.min()) <= 1e-6 else None
    if misses is not None:
        depth[misses] = 1.0
    found = []
    for row in m[:2]:
        along = row[0] * x
        along += row[1] * y
        along += row[2]
        along /= depth
        along += np.float32(PAD - 0.5)
        if misses is not None:
            along[misses] = -9.0
        found.append(np.clip(along, np.float32(-9.0), np.float32(9000.0), out=along))
    return found[0], found[1]


def true_corners(target: SceneTarget, view: CameraView) -> dict[tuple[str, int], Array]:
    """Exact image corners of every tag of a target that faces the camera.

    Returns:
        By (family, id): `(4, 2)` [px, centres at integers], TL, TR, BR, BL of the print; NaN rows for corners behind the lens.
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


def _ray_from_plane(body: Pose, view: CameraView) -> Array:
    """Homography `(3, 3)` from a body's xy plane [m] to rays (x, y, 1) of the camera."""
    rotation = view.enu_from_cam.T @ body.enu_from_body
    offset = view.camera_points(body.position_enu[None])[0]
    return np.column_stack([rotation[:, 0], rotation[:, 1], offset])


def _clip_near(points_cam: Array) -> Array:
    """The part of a closed polygon `(n, 3)` in front of the lens."""
    kept: list[Array] = []
    for a, b in zip(points_cam, np.roll(points_cam, -1, axis=0), strict=True):
        if a[2] > NEAR_M:
            kept.append(a)
        if (a[2] > NEAR_M) != (b[2] > NEAR_M):
            kept.append(a + (NEAR_M * 1.01 - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept).reshape(-1, 3)


def _cell_sizes(
    cells_from_ray: Array, x: Image32, y: Image32, focal: float, shape: tuple[int, ...]
) -> tuple[float, float]:
    """Largest and smallest extent of a cell in the window [px]; (0, 0) when no sample sees the layer."""
    rows, columns = (np.linspace(0, n - 1, min(n, 9)).astype(int) for n in x.shape)
    px, py = x[np.ix_(rows, columns)].ravel(), y[np.ix_(rows, columns)].ravel()
    rays = np.stack([px, py, np.ones_like(px)]).astype(np.float64)
    u, v, w = cells_from_ray @ rays
    front = w > 1e-6
    u, v, w = u[front] / w[front], v[front] / w[front], w[front]
    inside = (u > -1) & (u < shape[1] + 1) & (v > -1) & (v < shape[0] + 1)
    if not inside.any():
        inside = np.ones_like(u, dtype=bool)
    if not inside.size:
        return 0.0, 0.0
    m = cells_from_ray
    jacobian = np.stack(
        [
            np.stack([(m[0, k] - u[inside] * m[2, k]) / w[inside] for k in (0, 1)], axis=-1),
            np.stack([(m[1, k] - v[inside] * m[2, k]) / w[inside] for k in (0, 1)], axis=-1),
        ],
        axis=-2,
    )
    stretch = np.linalg.svd(jacobian / focal, compute_uv=False)  # cells per pixel
    return float(1.0 / stretch[:, 1].min()), float(1.0 / stretch[:, 0].max())


def _draw_cover(image: Image32, cover: Cover, pose: Pose, view: CameraView) -> None:
    """Lay an occluder over the target, its grain borrowed from its outline's place on the ground."""
    flat = np.asarray(cover.polygon, dtype=np.float64)
    steps = np.linspace(0.0, 1.0, 6, endpoint=False)[:, None]
    edge = np.concatenate([a + steps * (b - a) for a, b in zip(flat, np.roll(flat, -1, axis=0), strict=True)])
    corners = _clip_near(view.camera_points(pose.points(np.column_stack([edge, np.zeros(len(edge))]))))
    if len(corners) < 3:
        return
    seen = np.clip(project(corners, view.intrinsics), -4000.0, 4000.0)
    mask = np.zeros(image.shape, dtype=np.uint8)
    cv2.fillPoly(mask, [np.rint(seen * 16).astype(np.int32)], 255, cv2.LINE_AA, shift=4)
    share = mask.astype(np.float32) * np.float32(1 / 255)
    image += share * (np.float32(min(cover.reflectance, PAPER)) - image)
