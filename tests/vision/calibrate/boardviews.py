"""Rendered views of a calibration board through a known lens."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mkdaemon.frames import rotation_from_euler
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import single
from mksim.scene.layers import Layer, sheet_layer
from mksim.scene.light import LightConditions
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView, ViewPose

LENS = Intrinsics(
    width=640, height=480, fx=512.3, fy=514.8, cx=326.4, cy=236.1, k1=-0.21, k2=0.06, p1=0.0008, p2=-0.0005
)
"""64 x 50 deg with barrel distortion of 25 px in the corners."""

PLACES = (
    # column, row of its middle [share of the picture], distance over width, tilt about y, about x, turn [deg]
    (0.5, 0.5, 1.0, 0, 0, 0),
    (0.28, 0.3, 1.3, 28, 10, 5),
    (0.72, 0.3, 1.3, -28, 12, -8),
    (0.28, 0.7, 1.3, 25, -25, 90),
    (0.72, 0.7, 1.3, -25, -28, 170),
    (0.5, 0.5, 1.0, 40, 0, 20),
    (0.5, 0.5, 1.0, -40, 5, -30),
    (0.5, 0.5, 1.1, 0, 40, 0),
    (0.5, 0.5, 1.1, 4, -40, 10),
    (0.5, 0.5, 2.6, 10, 20, 10),
    (0.2, 0.25, 1.7, 15, 15, 45),
    (0.8, 0.75, 1.7, -15, -15, -45),
    (0.8, 0.25, 1.7, -20, 20, 30),
    (0.2, 0.75, 1.7, 20, -20, -60),
)


class _Held:
    """A board held before a camera that looks north from the origin, a second in each of its places."""

    def __init__(self, width: float, places: tuple[tuple[float, ...], ...], lens: Intrinsics) -> None:
        self._width, self._places, self._lens = width, places, lens

    def pose_at(self, time: float) -> ViewPose:
        column, row, far, about_y, about_x, turn = self._places[int(time)]
        distance, lens = far * self._width, self._lens
        x = (column * lens.width - lens.cx) / lens.fx * distance
        z = -(row * lens.height - lens.cy) / lens.fy * distance
        upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        tilt = rotation_from_euler(np.radians(about_x), np.radians(about_y), np.radians(turn))
        return ViewPose(upright @ tilt, np.array([x, distance, z]))


def board_views(
    layers: tuple[Layer, ...],
    width: float,
    lens: Intrinsics = LENS,
    places: tuple[tuple[float, ...], ...] = PLACES,
    conditions: LightConditions | None = None,
) -> list[npt.NDArray[np.uint8]]:
    """Render a board of `width` [m] in `places`."""
    looking_north = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    sheet = sheet_layer(layers[0].width * 1.08, layers[0].height * 1.1)
    held = SceneTarget(single(1.0, 0), (sheet, *layers), _Held(width, places, lens))
    scene = Scene([held], ground=None, seed=0, fine=False)
    return [
        scene.render(CameraView(lens, looking_north, np.zeros(3), time=k + 0.5), conditions) for k in range(len(places))
    ]
