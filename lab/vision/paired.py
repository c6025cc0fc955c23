"""Two trees on the same images: `python -m lab.vision.paired render|look|compare`.

Images are rendered once and kept with their truth. Each tree looks at them in a process of its own, with its `src`
first on PYTHONPATH; what both made of every image is compared one by one:

    python -m lab.vision.paired render build/paired 90000000
    PYTHONPATH=../before/src python -m lab.vision.paired look build/paired build/before.json
    PYTHONPATH=src python -m lab.vision.paired look build/paired build/after.json
    python -m lab.vision.paired compare build/before.json build/after.json
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.vision import tagfree
from lab.vision.decks import LIES
from lab.vision.flight import GROUNDS, LOOKING_DOWN, VGA
from lab.vision.leaving import CAMERAS, ways_out
from lab.vision.pairedscenes import Setting, views
from lab.vision.real import DEVICES
from lab.vision.stills import WRONG_DEG, WRONG_M, error_of, target_named
from lab.vision.weather import SKIES
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from mkdaemon.vision.track.tracker import Tracker
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget

Array = npt.NDArray[np.float64]

FLIGHT: Final = 60
"""Images of a flight: 2 s."""
COLD_M: Final = (0.15, 0.5, 1.0, 2.0, 4.57, 6.0, 8.0, 10.0, 12.0)
HIDDEN: Final = ("side_cut_10", "patches_10", "patches_20", "shadow_4_to_1", "glare_0.2", "exposure_6", "noise_sd_40")
EACH, LEFT, FREE = 6, 80, 24
"""Stills of a kind, images of a kind of leaving target, images of a ground without a target."""
FIRST_LOOKS: Final = 24
"""At a first image, until it is posed."""
SHARE_M: Final = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One image: pixels, time [s], reported attitude `(n, 4)`, and where the target is; NaN without one."""

    pixels: npt.NDArray[np.uint8]
    time: float
    attitude: Array
    rotation: Array
    position: Array


@dataclass(frozen=True, slots=True)
class Scenes:
    """Images that belong together.

    Attributes:
        name: scene, target and what is special.
        target: its name.
        lens: what the eyes take the camera for.
        follows: whether the images follow each other; others are looked at as if nothing was known before.
        shots: rendered one after the other.
    """

    name: str
    target: str
    lens: Intrinsics
    follows: bool
    shots: Iterable[Shot]


def scenes(base: int) -> Iterator[Scenes]:
    """All that is shown, drawn from seeds from `base` on."""
    flown = [("flights", name, "flights", 900) for name in ("nested", "single")]
    flown += [("far", name, "far", 910) for name in ("nested", "single")]
    flown += [("cameras", "nested", name, 1300) for name in DEVICES]
    flown += [("decks", ("nested", "single")[k % 2], name, 1200) for k, name in enumerate(LIES)]
    flown += [("hardships", "nested", name, 1400) for name in SKIES]
    flown += [("hardships", "single", "leaf_shadows", 1401)]
    settings = [Setting(scene, name, which, base + seed, 0, FLIGHT) for scene, name, which, seed in flown]
    stills: list[tuple[str, str, str | float]] = [("cold", n, m) for n in ("nested", "single") for m in COLD_M]
    stills += [("hidden", "nested", condition) for condition in HIDDEN] + [("steep", "single", 75.0)]
    settings += [Setting(*still, base + 950, k, EACH) for k, still in enumerate(stills)]
    for one in settings:
        name = f"{one.scene} {one.target} {one.which}"
        shots = (_shot(v.image, v.attitude, v.rotation, v.position) for v in views(one))
        yield Scenes(name, one.target, one.lens, one.is_flight, shots)
    for k, (name, camera) in enumerate((name, camera) for name in ("nested", "single") for camera in CAMERAS):
        left = ways_out(name, camera, LEFT, base + 1310 + k, 0)
        shots = (_shot(s.image, s.attitude, s.rotation, s.position) for _, s in left)
        yield Scenes(f"leaving {name} {camera}", name, CAMERAS[camera], True, shots)
    for k in range(len(GROUNDS)):
        yield Scenes(f"free {GROUNDS[k]}", "nested", VGA, True, _free(base + 600, k))


def _shot(image: CameraImage, attitude: AttitudeHistory, rotation: Array, position: Array) -> Shot:
    near = [s for s in attitude.samples if abs(s.time - image.captured_at) < 1.0]
    said = np.array([(s.time, s.roll, s.pitch, s.yaw) for s in near]).reshape(-1, 4)
    return Shot(image.pixels, image.captured_at, said, rotation, position)


def _free(seed: int, part: int) -> Iterator[Shot]:
    """Grounds without a target, in every light."""
    rng = np.random.default_rng([seed, 0xFA15E, part])
    anchor = SceneTarget.of(target_named("single"), Platform())
    scene = Scene([anchor], ground=GROUNDS[part], seed=seed + part, fine=False)
    for k in range(FREE):
        pixels = scene.render(tagfree.view(rng), tagfree.conditions(rng))
        yield Shot(pixels, (k + 0.5) / 30, np.zeros((0, 4)), np.full((3, 3), np.nan), np.full(3, np.nan))


def render(into: Path, base: int) -> None:
    """Render all images once; what is there already stays."""
    into.mkdir(parents=True, exist_ok=True)
    for k, scene in enumerate(scenes(base)):
        if (into / f"{k:03d}.npz").exists():
            continue
        shots = list(scene.shots)
        said = [shot.attitude for shot in shots]
        np.savez(
            into / f"{k:03d}.npz",
            about=json.dumps([scene.name, scene.target, scene.lens.model_dump_json(), scene.follows]),
            pixels=np.stack([shot.pixels for shot in shots]),
            time=np.array([shot.time for shot in shots]),
            attitude=np.concatenate(said),
            ends=np.cumsum([len(one) for one in said]),
            rotation=np.stack([shot.rotation for shot in shots]),
            position=np.stack([shot.position for shot in shots]),
        )
        print(scene.name, len(shots), file=sys.stderr, flush=True)


def _kept(file: Path) -> Scenes:
    kept = np.load(file)
    name, target, lens, follows = json.loads(str(kept["about"]))
    said = np.split(kept["attitude"], kept["ends"][:-1])
    columns = (kept["pixels"], kept["time"], said, kept["rotation"], kept["position"])
    shots = [Shot(*row) for row in zip(*columns, strict=True)]
    return Scenes(name, target, Intrinsics.model_validate_json(lens), follows, shots)


def look(images: Path, part: str, make: Callable[..., Tracker] = Tracker) -> dict[str, list[dict[str, Any]]]:
    """What this tree makes of kept images: posed, wrong, processor times [ms], by scene and what was known.

    Args:
        images: of `render`.
        part: of the names of scenes that are looked at.
        make: the tracker of targets, lens and mounting.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for file in sorted(images.glob("*.npz")):
        scene = _kept(file)
        if part not in scene.name:
            continue
        for known in (True, False) if not scene.name.startswith("free") else (False,):
            found[f"{scene.name} {'with' if known else 'without'}"] = _look_at(scene, known, make)
        print(scene.name, file=sys.stderr, flush=True)
    return found


def _look_at(scene: Scenes, known: bool, make: Callable[..., Tracker]) -> list[dict[str, Any]]:
    target = target_named(scene.target)
    tracker = make(TagMap((target,)), scene.lens, LOOKING_DOWN)
    rows: list[dict[str, Any]] = []
    for k, shot in enumerate(scene.shots):
        if not scene.follows:
            tracker.reset()
        said = AttitudeHistory(AttitudeSample(*(float(v) for v in row)) for row in shot.attitude) if known else None
        image = CameraImage(shot.pixels.copy(), shot.time, shot.time, k, "bench", "driver")
        times, pose, refused = [], None, ""
        for turn in range(1 if scene.follows else FIRST_LOOKS):
            image.pixels[0, 0] ^= turn & 1  # equal images would be those of a frozen camera
            start = time.thread_time()
            result = tracker.update(replace(image, sequence=k + turn), said)
            times.append(round(1000.0 * (time.thread_time() - start), 2))
            pose, refused = result.pose_of(target.name), ",".join(str(one.reason) for one in result.refused)
            if pose is not None:
                break
        row: dict[str, Any] = {"posed": pose is not None, "wrong": False, "ms": times, "refused": refused}
        if pose is not None:
            error = error_of(pose.pose.rotation, pose.pose.position, shot.rotation, shot.position)
            far = max(WRONG_M, SHARE_M * float(np.linalg.norm(shot.position)))
            vector = np.array([*error.xyz, *error.rpy])
            nees = float(vector @ np.linalg.solve(pose.pose.covariance, vector)) / 6
            row |= {"wrong": not (error.distance <= far and error.angle_deg <= WRONG_DEG), "nees": round(nees, 3)}
            row |= {"cm": round(100 * error.distance, 3), "deg": round(error.angle_deg, 3)}
        rows.append(row)
    return rows


def compare(before: dict[str, Any], after: dict[str, Any]) -> str:
    """Posed and wrong of both, images only one of them posed, and times, by scene."""
    lines = [f"{'':52} images before after  lost  won wrong -> wrong  nees -> nees"]
    whole: dict[str, list[int]] = {}
    for name in (name for name in before if name in after):
        pairs = list(zip(before[name], after[name], strict=True))
        row = [len(pairs), *(sum(p[k]["posed"] for p in pairs) for k in (0, 1))]
        row += [sum(p[k]["posed"] and not p[1 - k]["posed"] for p in pairs) for k in (0, 1)]
        row += [sum(p[k]["wrong"] for p in pairs) for k in (0, 1)]
        nees = [np.mean([p[k]["nees"] for p in pairs if "nees" in p[k]] or [0.0]) for k in (0, 1)]
        lines.append(_line(name, row) + f"  {nees[0]:.2f} -> {nees[1]:.2f}")
        kind = "free" if name.startswith("free") else f"{name.split()[0]} {name.split()[-1]}"
        for key in (kind, "all"):
            whole[key] = [a + b for a, b in zip(whole.get(key, [0] * len(row)), row, strict=True)]
    lines += ["", *(_line(name, row) for name, row in whole.items()), ""]
    for what in ("free", "with", "without", "cold"):
        lines += [f"ms an image, {what}: {_times(before, what)} -> {_times(after, what)}"]
    return "\n".join(lines)


def _line(name: str, row: list[int]) -> str:
    images, was, now, lost, won, wrong, wrong_now = row
    return f"{name:52} {images:6} {was:6} {now:5} {-lost:5} {won:+4} {wrong:5} -> {wrong_now}"


def _times(found: dict[str, Any], what: str) -> str:
    """Median, mean, 99th percentile and largest processor time of flights with or without attitude, or other scenes."""
    flown = ("flights", "far", "cameras", "decks", "hardships")
    names = [n for n in found if n.startswith(what) or (n.split()[-1] == what and n.startswith(flown))]
    ms = np.array([one for n in names for row in found[n] for one in row["ms"]])
    if not len(ms):
        return "none"
    return f"{np.median(ms):.1f} median {ms.mean():.1f} mean {np.percentile(ms, 99):.1f} p99 {ms.max():.1f} largest"


def main(verb: str, *args: str) -> None:
    """Run one step; see the module."""
    cv2.setNumThreads(1)
    if verb == "render":
        render(Path(args[0]), int(args[1]))
    elif verb == "look":
        found = look(Path(args[0]), args[2] if len(args) > 2 else "")
        Path(args[1]).write_text(json.dumps(found), encoding="utf-8")
    else:
        before, after = (json.loads(Path(name).read_text(encoding="utf-8")) for name in args[:2])
        print(compare(before, after))


if __name__ == "__main__":
    main(*sys.argv[1:])
