"""Draw flat prints into an image: which layers are seen, how densely to sample them, where every sample lands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from mksim.scene.layers import PAD, PAPER, Layer
from mksim.scene.light import Cover
from mksim.scene.view import NEAR_M, CameraView, Pose, RayGrid, project

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


def visible_layers(layers: Sequence[Layer], pose: Pose, view: CameraView, rays: RayGrid) -> list[SeenLayer]:
    """Layers of one body that can be seen, from the back to the front."""
    found: list[SeenLayer] = []
    for layer in layers:
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


def ray_from_plane(body: Pose, view: CameraView) -> Array:
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


def draw_covers(image: Image32, covers: Sequence[Cover], pose: Pose, view: CameraView) -> None:
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


def polygon_mask(outlines: Sequence[Array], pose: Pose, view: CameraView) -> Image32:
    """Share of every pixel that lies inside outlines `(n, 3)` [m; target], `(height, width)` of the camera."""
    mask = np.zeros((view.intrinsics.height, view.intrinsics.width), dtype=np.uint8)
    for outline in outlines:
        corners = _clip_near(view.camera_points(pose.points(outline)))
        if len(corners) >= 3:
            seen = np.clip(project(corners, view.intrinsics), -4000.0, 4000.0)
            cv2.fillPoly(mask, [np.rint(seen * 16).astype(np.int32)], 255, cv2.LINE_AA, shift=4)
    return mask.astype(np.float32) * np.float32(1 / 255)
