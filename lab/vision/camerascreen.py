"""The picture of docs/cameras.md: what `mkctl camera` shows of a rendered view, on a terminal without colours."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

import numpy as np
from rich.text import Text

from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.camera import render
from mkdaemon.client.cameralook import CameraLook
from mkdaemon.client.samples import Sample
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.vision import Exposure, EyeState, Tags, TagSighting, VisionStats
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.imagecodec import encode_jpeg
from mkdaemon.vision.tags.tagmap import Target
from mksim.scene.ground import Ground
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget, true_corners
from mksim.scene.view import CameraView
from tools.screensvg import screen_svg

VGA: Final = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
HEIGHT: Final = 0.9
"""Of the camera over the target, looking down [m]."""
COLUMNS: Final = 80
_STAMP: Final = Stamp(monotonic=0.0, wall=0.0)


def camera_screen(target: Target, path: Path) -> None:
    """Render a view from above, and write what `mkctl camera` shows of it as SVG."""
    placed = SceneTarget.of(target, Platform())
    down = np.column_stack([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    view = CameraView(VGA, down, np.array([0.06, -0.04, HEIGHT]))
    pixels = Scene([placed], ground=Ground("asphalt", 11), seed=11, fine=False).render(view)
    look = CameraLook("down")
    jpeg, width, height = encode_jpeg(pixels, 80, VGA.width)
    seen = {"stamp": _STAMP, "camera": "down", "sequence": 1}
    tags = tuple(
        TagSighting(
            family=family,
            id=number,
            hamming=0,
            decision_margin=80.0,
            corners=tuple((float(x), float(y)) for x, y in corners),
            search="grey",
        )
        for (family, number), corners in true_corners(placed, view).items()
    )
    for kind, value in (
        ("stats", _stats()),
        ("tags", Tags(**seen, stamped_by="driver", tags=tags)),
        ("image", CameraFrame(**seen, width=width, height=height, coding="jpeg", pixels=jpeg)),
    ):
        name = "" if kind == "image" else f"application/msgpack;mk.{type(value).__name__}.v1"
        look.take(Sample(f"vision/down/{kind}", value.model_dump(), name))
    look.target = f"{target.name} x +0.06 y -0.04 z {HEIGHT:.2f} m"
    console = Console(file=io.StringIO(), width=COLUMNS)
    console.print(render(look, console))
    shown = console.file.getvalue()  # type: ignore[attr-defined]  # a StringIO
    path.write_text(screen_svg([Text(line) for line in shown.rstrip("\n").split("\n")], COLUMNS), encoding="utf-8")


def _stats() -> VisionStats:
    """Figures of a camera that exposes for too long."""
    return VisionStats(
        stamp=_STAMP,
        camera="down",
        state=EyeState.OK,
        reason="",
        alarms={},
        source="/dev/video0",
        width=VGA.width,
        height=VGA.height,
        fps=29.7,
        processed=900,
        dropped=9,
        lost=0,
        damaged=0,
        reopened=0,
        faults=0,
        restarts=0,
        posed=0.93,
        refused={},
        detect_p50_ms=9.0,
        detect_p99_ms=21.0,
        latency_p50_ms=41.0,
        latency_p99_ms=63.0,
        settings_refused=(),
        exposure=Exposure(exposure_ms=18.0, gain=1.0, black=14.0, white=150.0, noise=2.0),
    )
