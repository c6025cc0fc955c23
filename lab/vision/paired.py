"""`python -m lab paired`: 4,768 images of every kind that the other campaigns have, each a row of its own.

    python -m lab compare ../before . -- paired

shows them to the eyes of two trees, and says which images only one of them poses, or poses wrongly.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import cv2
import numpy as np
from cyclopts import Parameter

from lab.campaign import Ending, Results, each_result, plain
from lab.tables import show
from lab.vision import tagfree
from lab.vision.cases import draws
from lab.vision.decks import LIES
from lab.vision.flight import FPS, GROUNDS, LOOKING_DOWN, FlightFrame, fly
from lab.vision.flights import frames_of, lens_of
from lab.vision.leaving import CAMERAS, ways_out
from lab.vision.looks import look
from lab.vision.real import DEVICES
from lab.vision.stills import Still, Studio, look_once, target_named
from lab.vision.weather import SKIES
from mkdaemon.cli.arguments import AsJson
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory
from mkdaemon.vision.track.tracker import Tracker, VisionResult

FLIGHT, EACH, LEFT, FREE = 60, 6, 80, 24
"""Images of a flight, of a kind of stills, of a kind of leaving target, and of a ground without a target."""
FAR_FLIGHT_M: Final = (3.0, 9.0)
COLD_M: Final = (0.15, 0.5, 1.0, 2.0, 4.57, 6.0, 8.0, 10.0, 12.0)
HIDDEN: Final = ("side_cut_10", "patches_10", "patches_20", "shadow_4_to_1", "glare_0.2", "exposure_6", "noise_sd_40")
FIRST_LOOKS: Final = ("cold", "hidden", "steep")
"""Scenes of first images; in the others the images follow each other."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What one scene shows.

    Attributes:
        scene: a kind of flight, of first images, `leaving` or `free`.
        target: its name.
        which: camera, hardship, deck, condition, ground, distance [m] or tilt [deg].
        seed: draws it.
        images: how many there are.
        part: draws apart what has the same seed.
    """

    scene: str
    target: str
    which: str | float
    seed: int
    images: int
    part: int = 0

    @property
    def lens(self) -> Intrinsics:
        """What the eyes take the camera for."""
        which = str(self.which)
        return CAMERAS[which] if self.scene == "leaving" else lens_of(self.scene, which)

    def views(self) -> Iterator[FlightFrame | Still]:
        """Render it, image by image."""
        target, which, seconds = target_named(self.target), str(self.which), self.images / FPS
        match self.scene:
            case "leaving":
                yield from ways_out(self.target, which, self.images, self.seed, 0)
            case "free":
                yield from self._grounds()
            case "far":
                yield from fly(target, self.seed, seconds=seconds, near=FAR_FLIGHT_M[0], far=FAR_FLIGHT_M[1])
            case "decks" | "cameras" | "hardships" | "flights":
                yield from frames_of(self.scene, which, target, self.seed, seconds)
            case _:
                yield from self._stills()

    def _stills(self) -> Iterator[Still]:
        target = target_named(self.target)
        studio = Studio(target, self.seed, fine=False, part=self.part)
        for _ in range(self.images):
            rng = studio.rng
            if self.scene == "hidden":
                conditions = draws(target.tags[0].size)[str(self.which)](rng)
                yield studio.shoot(float(rng.uniform(0.5, 2.0)), float(rng.uniform(0, 0.7)), conditions, off=0.08)
            elif self.scene == "steep":
                yield studio.shoot(2.0, float(np.radians(self.which)), off=0.02)
            else:
                distance = float(self.which)
                yield studio.shoot(distance, float(rng.uniform(0, 0.7)), off=0.05 if distance < 0.2 else 0.12)

    def _grounds(self) -> Iterator[Still]:
        """A ground without a target, in every light."""
        for k, (_, pixels) in enumerate(tagfree.grounds(self.seed, self.part, self.images)):
            image = CameraImage(pixels, (k + 0.5) / FPS, (k + 0.5) / FPS, k, "bench", "driver")
            yield Still(image, AttitudeHistory([]), np.eye(3), np.full(3, np.nan))


def settings(base: int) -> list[Setting]:
    """All that is shown, drawn from seeds from `base` on."""
    both = ("nested", "single")
    flown = [(scene, name, scene, seed) for scene, seed in (("flights", 900), ("far", 910)) for name in both]
    flown += [("cameras", "nested", name, 1300) for name in DEVICES]
    flown += [("decks", both[k % 2], name, 1200) for k, name in enumerate(LIES)]
    flown += [("hardships", "nested", name, 1400) for name in SKIES] + [("hardships", "single", "leaf_shadows", 1401)]
    stills: list[tuple[str, str, str | float]] = [("cold", name, distance) for name in both for distance in COLD_M]
    stills += [("hidden", "nested", condition) for condition in HIDDEN] + [("steep", "single", 75.0)]
    left = [(name, camera) for name in both for camera in CAMERAS]
    return [
        *(Setting(scene, target, which, base + seed, FLIGHT) for scene, target, which, seed in flown),
        *(Setting(*still, base + 950, EACH, k) for k, still in enumerate(stills)),
        *(Setting("leaving", name, camera, base + 1310 + k, LEFT) for k, (name, camera) in enumerate(left)),
        *(Setting("free", "nested", GROUNDS[k], base + 600, FREE, k) for k in range(len(GROUNDS))),
    ]


def looked_at(setting: Setting) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """What these eyes make of a setting with attitude and without: key and row of every image."""
    cv2.setNumThreads(1)
    target = target_named(setting.target)
    trackers = {known: Tracker(TagMap((target,)), setting.lens, LOOKING_DOWN) for known in (True, False)}
    rows = []
    for k, shown in enumerate(setting.views()):
        for known, tracker in trackers.items():
            start = time.thread_time()
            if setting.scene in FIRST_LOOKS:
                assert isinstance(shown, Still)
                result = look_once(shown, target, setting.lens, with_attitude=known)
            else:
                result = tracker.update(shown.image, shown.attitude if known else None)
            key = {"scene": setting.scene, "target": setting.target, "which": setting.which, "image": k, "knows": known}
            rows.append((key, _row(setting, shown, result, round(1000.0 * (time.thread_time() - start), 2))))
    return rows


def _row(setting: Setting, shown: FlightFrame | Still, result: VisionResult, ms: float) -> dict[str, Any]:
    found = look(shown, result.pose_of(target_named(setting.target).name))
    if not found.posed:
        return {"ending": Ending.REFUSED, "why": ",".join(str(one.reason) for one in result.refused), "ms": ms}
    wrong = found.wrong or setting.scene == "free"
    errors = {"cm": round(100 * found.off, 3), "deg": round(found.turned, 3), "nees": round(found.nees, 3)}
    return {"ending": Ending.WRONG if wrong else Ending.FINISHED, "ms": ms} | errors


def main(
    *,
    base: Annotated[int, Parameter(help="First seed.")] = 90_000_000,
    jobs: Annotated[int, Parameter(help="Processes.")] = 2,
    results: Annotated[Path | None, Parameter(help="File of the rows.")] = None,
    as_json: AsJson = False,
) -> int:
    """Show the images to these eyes, 20 minutes; exit code 1 for a wrong pose."""
    kept, counts = Results(results), Counter[tuple[str, str]]()
    asked = settings(base)
    for number, rows in each_result(looked_at, asked, jobs):
        for key, row in rows:
            kept.add("paired", key, plain(row))
            counts[asked[number].scene, row["ending"]] += 1
    shown = [
        {"scene": scene, **{ending.value: counts[scene, ending] for ending in Ending if counts[scene, ending]}}
        for scene in dict.fromkeys(setting.scene for setting in asked)
    ]
    return show([row | {"holds": Ending.WRONG not in row} for row in shown], ("scene",), as_json=as_json)
