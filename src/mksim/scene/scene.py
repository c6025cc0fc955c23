"""The landing scene: flat prints on a textured ground, seen by a moving camera.

Each print is carried into the image by inverting the exact projection for every sample, so distortion, perspective
and anti-aliasing need no intermediate image. How an edge stays where it belongs is described in `layers`; the
independent truth is `view.project`. `roll` is a rolling shutter: every row is exposed at its own time, and all
rows are carried to one camera at the middle of the image. A ray of a row hits the plane of the scene where the moved
camera sees it, and the standing camera sees that point along another ray: exact for everything in that plane. With
walls, whatever stands or is raised is drawn after the ground and what lies on it, in the order of `walls`, each by its
plane's rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import Target
from mksim.scene.analogvideo import FIELD_TIME, weave
from mksim.scene.curl import bend
from mksim.scene.gloss import add_gloss
from mksim.scene.ground import Ground, GroundKind
from mksim.scene.hindrances import add_drops, add_fog, add_propellers, flickered
from mksim.scene.layers import PAD, PAPER, Layer, print_target
from mksim.scene.lensfaults import add_dirt, add_fringe
from mksim.scene.light import Cover, LightConditions, Sensor, add_glare, lens_blur, shade, streak
from mksim.scene.shadows import shade_leaves, shade_vehicle
from mksim.scene.view import NEAR_M, CameraView, RayGrid, ViewPose, project, rotation_from_vector
from mksim.scene.walls import Surface, back_to_front, flow_of

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SeenLayer:
    """A layer as one camera sees it.

    Attributes:
        layer: what was printed.
        cells_from_ray: homography `(3, 3)` from rays (x, y, 1) to cells.
        rows: part of the image that may show it.
        columns: the same across.
        fills_image: nothing else can be seen.
    """

    layer: Layer
    cells_from_ray: Array
    rows: slice
    columns: slice
    fills_image: bool


def draw_layer(image: Image32, seen: SeenLayer, rays: RayGrid, budget: int) -> None:
    """Composite one layer over `image` in place, its window sampled with at most `budget` rays."""
    layer, cells_from_ray, rows, columns = seen.layer, seen.cells_from_ray, seen.rows, seen.columns
    x, y = rays.x[rows, columns], rays.y[rows, columns]
    widest, narrowest = _cell_sizes(cells_from_ray, x, y, rays.intrinsics.fx, layer.cells.shape)
    if widest <= 0.0:
        return
    allowed = max(int(np.sqrt(budget / x.size)), 1)
    # Two samples a cell at least: coarser texels would blur a far inner tag by two of its cells.
    wanted = np.ceil(max(0.8 * widest, 2.0) / narrowest)
    factor = int(np.clip(wanted, min(2, allowed), min(6, allowed)))
    density = layer.texels_per_cell(max(narrowest * factor, widest / 1.5))
    u, v = _texel_map(cells_from_ray, density, *rays.fine(rows, columns, factor))
    whole, shade = seen.fills_image, layer.shade
    # One channel is enough where nothing shows through, and for a blank sheet.
    texture = layer.texture(density, 0 if whole else 1 if shade is not None else None)
    sampled = cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    if factor > 1:
        sampled = cv2.resize(sampled, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    part = image[rows, columns]
    if whole:
        part[...] = sampled
    elif shade is not None:
        part += sampled * (np.float32(shade) - part)
    else:
        reflected, covered = cv2.split(sampled)
        np.subtract(np.float32(1.0), covered, out=covered)
        part *= covered
        part += reflected


def visible_layers(layers: Sequence[Layer], pose: ViewPose, view: CameraView, rays: RayGrid) -> list[SeenLayer]:
    """Layers of one body that can be seen, from the back to the front."""
    found: list[SeenLayer] = []
    for layer in layers:
        body = ViewPose(pose.enu_from_body @ layer.rotation, pose.points(layer.position[None])[0])
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
        cells_from_ray = layer.cells_from_plane() @ np.linalg.inv(ray_from_plane(body, view))
        fills = _fills_image(cells_from_ray, layer.cells.shape, rays)
        found.append(SeenLayer(layer, cells_from_ray, rows, columns, fills))
    return found


def _fills_image(cells_from_ray: Array, shape: tuple[int, ...], rays: RayGrid) -> bool:
    """Whether the rim of the image, and so all of it, lies inside the layer."""
    u, v, w = cells_from_ray @ rays.rim
    in_front, left, top = w > 1e-6, u > 0, v > 0
    return bool((in_front & left & top & (u < shape[1] * w) & (v < shape[0] * w)).all())


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


def ray_from_plane(body: ViewPose, view: CameraView) -> Array:
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


def draw_covers(image: Image32, covers: Sequence[Cover], pose: ViewPose, view: CameraView) -> None:
    """Lay occluders over the target, those of one shade together; each shade hides those before it."""
    for reflectance in dict.fromkeys(cover.reflectance for cover in covers):
        outlines = [_cover_outline(cover) for cover in covers if cover.reflectance == reflectance]
        image += polygon_mask(outlines, pose, view) * (np.float32(min(reflectance, PAPER)) - image)


def _cover_outline(cover: Cover) -> Array:
    """Points along the edge of a cover `(n, 3)` [m; target]."""
    flat = np.asarray(cover.polygon, dtype=np.float64)
    steps = np.linspace(0.0, 1.0, 6, endpoint=False)[:, None]
    edge = np.concatenate([a + steps * (b - a) for a, b in zip(flat, np.roll(flat, -1, axis=0), strict=True)])
    return np.column_stack([edge, np.zeros(len(edge))])


def polygon_mask(outlines: Sequence[Array], pose: ViewPose, view: CameraView) -> Image32:
    """Share of every pixel that lies inside outlines `(n, 3)` [m; target], `(height, width)` of the camera."""
    mask = np.zeros((view.intrinsics.height, view.intrinsics.width), dtype=np.uint8)
    for outline in outlines:
        corners = _clip_near(view.camera_points(pose.points(outline)))
        if len(corners) >= 3:
            seen = np.clip(project(corners, view.intrinsics), -4000.0, 4000.0)
            cv2.fillPoly(mask, [np.rint(seen * 16).astype(np.int32)], 255, cv2.LINE_AA, shift=4)
    return mask.astype(np.float32) * np.float32(1 / 255)


LEAST_SLOPE = 1e-6
"""Rays that are nearer to parallel with the plane do not meet it."""


def roll(rays: RayGrid, view: CameraView, plane: ViewPose) -> RayGrid:
    """The rays of `view`'s camera while its rows are exposed one after the other.

    Args:
        rays: of the camera at rest.
        view: the camera when its middle row is exposed, and how it moves.
        plane: whose xy plane the scene lies in; it stands still.
    """
    x, y = rays.padded
    times = (np.arange(len(x)) - (len(x) - 1) / 2) * view.line_time
    turns = np.array([rotation_from_vector(view.turned(float(time))) for time in times])
    looks = np.stack([x, y, np.ones_like(x)], axis=2).astype(np.float64) @ turns.transpose(0, 2, 1)
    normal = view.enu_from_cam.T @ plane.enu_from_body[:, 2]
    height = float(normal @ view.camera_points(plane.position_enu[None])[0])
    places = times[:, None] * (view.enu_from_cam.T @ view.velocity_enu)
    slope = looks @ normal
    distance = (height - places @ normal)[:, None] / np.where(np.abs(slope) > LEAST_SLOPE, slope, np.inf)
    hits = places[:, None, :] + distance[:, :, None] * looks
    meets = (distance > 0.0) & (hits[:, :, 2] > 0.0)
    seen = np.where(meets[:, :, None], hits, looks)
    depth = np.maximum(seen[:, :, 2:], LEAST_SLOPE)
    carried = (seen[:, :, :2] / depth).astype(np.float32)
    return RayGrid(rays.intrinsics, (carried[:, :, 0], carried[:, :, 1]))


FINE_SAMPLES = 5_000_000
"""Most sub-samples a print may take in a still for measurements."""
SAMPLES = 1_400_000
"""The same in images of flights, four per pixel of 640 x 480: with one, far edges of a steep print that fills the image
are stairs, and look like a print that bends by half a millimetre."""
LIVE_SAMPLES = 330_000
"""The same in real time, one per pixel of 640 x 480."""
BORDER_PX = 8
"""How far beside the image a camera is drawn: a lens smears light from there into it, as do defocus and motion."""
WALL_SPREAD_PX, MOST_EXPOSURES = 1.5, 12
"""With walls, motion between two sub-exposures [px], and how many there are at most."""
NEUTRAL = 0.45
"""Reflectance of the ground where none is drawn."""


class Motion(Protocol):
    """How a target moves."""

    def pose_at(self, time: float) -> ViewPose:
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
        fine: spend up to five million samples a print, and follow motion by pixels.
        live: draw in real time.
        walls: that stand in it.
    """

    def __init__(
        self,
        targets: Sequence[SceneTarget],
        *,
        ground: GroundKind | Ground | None = "asphalt",
        seed: int = 0,
        fine: bool = True,
        live: bool = False,
        walls: Sequence[Surface] = (),
    ) -> None:
        self.targets = tuple(targets)
        self._walls = tuple(walls)
        self._ground = Ground(ground, seed) if isinstance(ground, str) else ground
        self._sensor = Sensor(seed)
        self._spread_px = 1.0 if fine else 4.0
        self._budget = LIVE_SAMPLES if live else FINE_SAMPLES if fine else SAMPLES
        self._rays: dict[Intrinsics, RayGrid] = {}

    def render(self, view: CameraView, conditions: LightConditions | None = None) -> npt.NDArray[np.uint8]:
        """Expose one image.

        Args:
            view: camera at the middle of its exposure.
            conditions: light, lens, sensor; the default is a good day.

        Returns:
            `(height, width)` uint8 of `view.intrinsics`.
        """
        conditions = conditions or LightConditions()
        if conditions.analog is None:
            return self._sensor.expose(self._light(view, conditions), conditions)
        first, second = (
            self._light(replace(view.moved(along * FIELD_TIME), exposure_time=view.exposure_time), conditions)
            for along in (-0.5, 0.5)
        )
        return self._sensor.expose(weave(first, second), conditions)

    def _light(self, view: CameraView, conditions: LightConditions) -> Image32:
        """Light on the sensor, 1 is a perfect reflector in full light."""
        outer = view.wider(BORDER_PX)
        rays = self._rays.get(view.intrinsics)
        if rays is None:
            rays = self._rays.setdefault(view.intrinsics, RayGrid(outer.intrinsics))
        plain = rays
        if view.line_time > 0.0 and self.targets:
            rays = roll(rays, outer, self.targets[0].motion.pose_at(view.time))
        if conditions.curl is not None and self.targets:
            rays = bend(rays, outer, self.targets[0].motion.pose_at(view.time), conditions.curl)
        light = self._exposed(outer, conditions, rays, plain)
        if conditions.fog is not None and self.targets:
            light = add_fog(light, conditions.fog, outer, rays, self.targets[0].motion.pose_at(view.time))
        light = lens_blur(light, conditions)[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX].copy()
        if conditions.fringe_px > 0.0:
            light = add_fringe(light, conditions.fringe_px)
        if conditions.flicker is not None:
            light = flickered(light, conditions.flicker, view)
        if conditions.propellers is not None:
            light = add_propellers(light, conditions.propellers, view)
        if conditions.drops is not None:
            light = add_drops(light, conditions.drops)
        if conditions.dirt is not None:
            light = add_dirt(light, conditions.dirt)
        return light

    def _exposed(self, view: CameraView, conditions: LightConditions, rays: RayGrid, plain: RayGrid) -> Image32:
        """Light on the sensor over the exposure.

        What all parts of the image share of the motion is one streak; what they do not share (turning, climbing) is
        followed by sub-exposures, each with its part of the streak.
        """
        flow = self._flow(view, rays)
        shared = flow.mean(axis=0)
        spread = float(np.linalg.norm(flow - shared, axis=1).max())
        count = int(np.clip(np.ceil(spread / self._spread_px), 1, 6))
        if self._walls:  # which share no motion with the ground
            fastest = max(float(np.linalg.norm(flow, axis=1).max()), flow_of(self._walls, view))
            count, shared = int(np.clip(np.ceil(fastest / WALL_SPREAD_PX), 1, MOST_EXPOSURES)), np.zeros(2)
        light = np.zeros(rays.x.shape, dtype=np.float32)
        for along in (np.arange(count) + 0.5) / count - 0.5:
            moved = view.moved(float(along) * view.exposure_time)
            image, raised = self._lit(moved, conditions, rays)
            if self._walls:
                self._draw_raised(image, raised, moved, plain)
            light += image
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

    def _lit(self, view: CameraView, conditions: LightConditions, rays: RayGrid) -> tuple[Image32, list[Surface]]:
        """Reflected light of a standing scene seen by a standing camera, before the lens.

        With walls, without what is raised above the ground: that is returned beside it.
        """
        layers: list[SeenLayer] = []
        raised: list[Surface] = []
        for target in self.targets if conditions.target_in_view else ():
            pose, lying = target.motion.pose_at(view.time), target.layers
            if self._walls:
                surfaces = [Surface(layer, pose) for layer in lying]
                raised += [surface for surface in surfaces if surface.is_raised]
                lying = tuple(surface.layer for surface in surfaces if not surface.is_raised)
            layers += visible_layers(lying, pose, view, rays)
        # What a print hides completely need not be drawn.
        first = max((k for k, seen in enumerate(layers) if seen.fills_image), default=None)
        if first is not None or self._ground is None:
            image = np.full(rays.x.shape, NEUTRAL, dtype=np.float32)
        else:
            image = self._ground.render(view, rays)
        for seen in layers[first or 0 :]:
            draw_layer(image, seen, rays, self._budget)
        if not self.targets:
            return image, raised
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
        return image, raised

    def _draw_raised(self, image: Image32, raised: Sequence[Surface], view: CameraView, plain: RayGrid) -> None:
        """Draw walls, and what hangs or stands, over the ground."""
        rolled: dict[tuple[float, ...], RayGrid] = {}
        for surface in back_to_front((*self._walls, *raised), view.position_enu):
            rays = plain
            seen = visible_layers([surface.layer], surface.pose, view, rays)
            if seen and view.line_time > 0.0:
                plane = surface.plane
                normal = plane.enu_from_body[:, 2]
                key = tuple(np.round([*normal, normal @ plane.position_enu], 3).tolist())
                rays = rolled.get(key) or rolled.setdefault(key, roll(plain, view, plane))
                seen = visible_layers([surface.layer], surface.pose, view, rays)
            for layer in seen:
                draw_layer(image, layer, rays, self._budget)


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
            seen[tag.code] = corners
    return seen


def cam_from_target(target: SceneTarget, view: CameraView) -> tuple[Array, Array]:
    """True pose of a target in the camera frame: rotation `(3, 3)`, translation `(3,)` [m; RDF]."""
    pose = target.motion.pose_at(view.time)
    return view.enu_from_cam.T @ pose.enu_from_body, view.camera_points(pose.position_enu[None])[0]
