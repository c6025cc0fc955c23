"""Views of targets with known pose for the tests of detector, pose and tracker."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.pose.pose import Pose, turn
from mkdaemon.vision.tags.tagmap import Target
from mkdaemon.vision.tags.targetfile import load
from mksim.scene.ground import Ground
from mksim.scene.light import CLEAN, LightConditions
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, cam_from_target, true_corners
from mksim.scene.view import CameraView
from tests.places import CONFIGS

VGA = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5, line_time=0.0)


@lru_cache(maxsize=4)
def shipped(name: str) -> Target:
    return load([CONFIGS / "targets" / f"{name}.toml"]).targets[0]


@lru_cache(maxsize=1)
def asphalt() -> Ground:
    return Ground("asphalt", 11)


@lru_cache(maxsize=2)
def on_the_ground(target: Target) -> SceneTarget:
    """A target at the origin; it keeps the textures that are drawn of it."""
    return SceneTarget.of(target, Platform())


@lru_cache(maxsize=8)
def scene(target: Target) -> tuple[Scene, SceneTarget]:
    """A scene for one test: its noise goes on from image to image, and starts anew for every test (`conftest`)."""
    placed = on_the_ground(target)
    return Scene([placed], ground=asphalt(), seed=11, fine=False), placed


def place(distance: float, tilt: float, around: float = 0.3, roll: float = 0.0) -> CameraView:
    """A camera looking at the origin from `distance` [m], `tilt` [rad] off the normal."""
    side = np.array([np.cos(around), np.sin(around), 0.0])
    position = distance * (np.sin(tilt) * side + np.cos(tilt) * np.array([0.0, 0.0, 1.0]))
    forward = -position / distance
    right = np.cross(forward, [np.sin(roll), np.cos(roll), 0.05])
    right /= np.linalg.norm(right)
    return CameraView(VGA, np.column_stack([right, np.cross(forward, right), forward]), position)


class View:
    """One rendered image and its truth."""

    def __init__(self, target: Target, view: CameraView, conditions: LightConditions | None = None) -> None:
        rendered, placed = scene(target)
        self.view = view
        self.pixels = rendered.render(view, conditions)
        self.rotation, self.position = cam_from_target(placed, view)
        self.corners = true_corners(placed, view)

    def image(self, time: float = 0.0, sequence: int = 0) -> CameraImage:
        return CameraImage(self.pixels, time, time, sequence, "test", "driver")


class PlainView(View):
    """A print on nothing, or on a ground, by a scene that no other test shares: its noise depends on no order."""

    def __init__(
        self,
        target: Target,
        view: CameraView,
        conditions: LightConditions = CLEAN,
        seed: int = 4,
        ground: Ground | None = None,
    ) -> None:
        placed = on_the_ground(target)
        self.view = view
        self.pixels = Scene([placed], ground=ground, seed=seed, fine=False).render(view, conditions)
        self.rotation, self.position = cam_from_target(placed, view)


def start_at(view: View, off_deg: float = 0.0, nearer: float = 1.0, sd: float = 1e-3, source: str = "edges") -> Pose:
    """A pose to begin with: the true one, turned about all axes [deg], its range scaled, by a deviation [m, rad]."""
    rotation = turn(view.rotation, np.radians(off_deg) * np.ones(3))
    return Pose(rotation, nearer * view.position, sd**2 * np.eye(6), source, 200, 0.05)


def printed(cells: npt.NDArray[np.uint8], pixels_per_cell: int = 20, margin: int = 3) -> npt.NDArray[np.uint8]:
    """A print held upright: cells magnified, white around; the first black pixel is at `margin * pixels_per_cell`."""
    return np.kron(np.pad(cells, margin, constant_values=255), np.ones((pixels_per_cell,) * 2, np.uint8))


def angle_deg(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> float:
    return float(np.degrees(np.linalg.norm(cv2.Rodrigues(a @ b.T)[0])))


def nearly(view: View) -> Pose:
    """What a track expects: nearly the truth."""
    turned = turn(view.rotation, np.radians([0.6, -0.5, 0.4]))
    return Pose(turned, 1.002 * view.position, 1e-6 * np.eye(6), "edges", 200, 0.05)


def nees(view: View, pose: Pose, covariance: npt.NDArray[np.float64] | None = None) -> float:
    """Per degree of freedom, the truth against what is claimed, by the pose where nothing else is given."""
    turned = cv2.Rodrigues(view.rotation @ pose.rotation.T)[0].ravel()
    error = np.concatenate([view.position - pose.position, turned])
    return float(error @ np.linalg.solve(pose.covariance if covariance is None else covariance, error)) / 6


def assert_near(
    pose: Pose | None,
    view: View,
    *,
    deg: float = np.inf,
    m: float = np.inf,
    claims: float = np.inf,
    inliers: float = 0.0,
    source: str = "",
) -> None:
    """Assert that a pose is where a view has its target.

    Args:
        deg: most by which its rotation may be off [deg].
        m: most by which its position may be off [m].
        claims: largest NEES of its covariance for each degree of freedom.
        inliers: least share of edges that agree.
        source: what it was measured by; anything where it is empty.
    """
    assert pose is not None
    assert angle_deg(pose.rotation, view.rotation) < deg
    assert np.linalg.norm(pose.position - view.position) < m
    assert claims == np.inf or nees(view, pose) < claims
    assert pose.inliers >= inliers
    assert source in ("", pose.source)
