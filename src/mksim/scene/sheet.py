"""A contact sheet of what the renderer does to a target, one condition a picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.files import write_whole
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.tags.tagmap import Target
from mksim.scene.analogvideo import AnalogVideo
from mksim.scene.flights import patches, side_cut
from mksim.scene.hardships import PROPELLERS
from mksim.scene.hindrances import Drops, Flicker, Fog
from mksim.scene.light import Glare, LightConditions, Shadow
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView, view_towards

COLUMNS = 5
ROLLING = 0.025 / 480
"""Line time of a rolling shutter [s]."""
CAMERA = Intrinsics(width=640, height=480, fx=600, fy=600, cx=319.5, cy=239.5, k1=-0.2, k2=0.05)


def contact_sheet(target: Target, path: Path, *, seed: int = 1) -> None:
    """Render `target` in each condition and write the labelled sheet as PNG to `path`."""
    pictures = [_labelled(image, text) for text, image in _pictures(target, seed)]
    rows = [np.hstack(pictures[first : first + COLUMNS]) for first in range(0, len(pictures), COLUMNS)]
    path.parent.mkdir(parents=True, exist_ok=True)
    _, picture = cv2.imencode(".png", np.vstack(rows))
    write_whole(path, picture.tobytes(), overwrite=True)


def _pictures(target: Target, seed: int) -> list[tuple[str, npt.NDArray[np.uint8]]]:
    """Captions and images."""
    pad = SceneTarget.of(target, Platform(heading=0.4))
    size = target.tags[0].size
    near = view_towards(CAMERA, np.array([0.15, -0.35, 0.85]), np.zeros(3))
    scenes = {kind: Scene([pad], ground=kind, seed=seed) for kind in ("asphalt", "grass", "tiles", "clutter")}

    def shot(
        view: CameraView = near, ground: str = "tiles", conditions: LightConditions | None = None
    ) -> npt.NDArray[np.uint8]:
        return next(scene for kind, scene in scenes.items() if kind == ground).render(
            view, conditions or LightConditions()
        )

    def at(east: float, north: float, up: float) -> CameraView:
        return view_towards(CAMERA, np.array([east, north, up]), np.zeros(3))

    fair = LightConditions()
    rolling = replace(near, line_time=ROLLING, exposure_time=0.001)
    moving = replace(near, rate_cam=np.array([0.3, 0.6, 0.0]), exposure_time=0.004)
    rng = np.random.default_rng(seed)
    return [
        ("fair, 0.9 m", shot()),
        ("1.6 m, 20 deg", shot(at(0.2, -0.5, 1.5), "asphalt")),
        ("4 m", shot(at(0.3, -0.8, 3.9), "grass")),
        ("overfilled, 0.2 m", shot(at(0.0, -0.02, 0.2))),
        ("76 deg, 2 m", shot(at(1.9, -0.3, 0.48), "clutter")),
        ("side cut 20 %", shot(conditions=replace(fair, covers=(side_cut(size, 0.2, 0),)))),
        ("patches 20 %", shot(conditions=replace(fair, covers=patches(rng, size, 0.2)))),
        ("hard shadow 4:1", shot(conditions=replace(fair, shadow=Shadow(4.0, direction=0.5)))),
        ("soft shadow 4:1", shot(conditions=replace(fair, shadow=Shadow(4.0, direction=0.5, softness=0.15)))),
        ("gradient 32:1", shot(conditions=replace(fair, gradient=32.0, gradient_angle=0.5))),
        ("glare 0.1 of the side", shot(conditions=replace(fair, glare=(Glare((0.05, 0.05), 0.1 * size),)))),
        ("glare 0.2 of the side", shot(conditions=replace(fair, glare=(Glare((-0.05, 0.05), 0.2 * size),)))),
        ("exposure 6 %", shot(conditions=replace(fair, exposure=0.06))),
        ("over-exposed", shot(conditions=replace(fair, exposure=2.5))),
        ("noise sd 40", shot(conditions=replace(fair, noise_sd=40.0))),
        ("JPEG quality 20", shot(conditions=replace(fair, jpeg_quality=20))),
        ("defocus 5 px", shot(conditions=replace(fair, defocus_px=5.0))),
        ("motion 10 px", shot(replace(near, rate_cam=np.array([0.5, 1.0, 0.0]), exposure_time=0.015))),
        ("turning 3 rad/s", shot(replace(near, rate_cam=np.array([0.0, 0.0, 3.0]), exposure_time=0.015))),
        ("out of view", shot(ground="clutter", conditions=replace(fair, target_in_view=False))),
        ("fog, 2 m of visibility", shot(conditions=replace(fair, fog=Fog(2.0)))),
        ("drops on the lens", shot(conditions=replace(fair, drops=Drops(seed)))),
        ("propellers, rolling shutter", shot(rolling, conditions=replace(fair, propellers=PROPELLERS))),
        ("lamps, rolling shutter", shot(rolling, conditions=replace(fair, flicker=Flicker(200.0, 0.8)))),
        ("analog video", shot(moving, conditions=replace(fair, analog=AnalogVideo(10.0, 1.0)))),
    ]


def _labelled(image: npt.NDArray[np.uint8], text: str) -> npt.NDArray[np.uint8]:
    """Half size, caption in a white strip below."""
    small = cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)
    framed = cv2.copyMakeBorder(small, 2, 22, 2, 2, cv2.BORDER_CONSTANT, value=255)
    cv2.putText(framed, text, (6, 258), cv2.FONT_HERSHEY_SIMPLEX, 0.45, 0, 1, cv2.LINE_AA)
    return np.asarray(framed, dtype=np.uint8)
