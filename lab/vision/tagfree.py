"""Images without any of the wanted tags, in which every search of the detector may find none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from lab.vision.flight import GROUNDS, LOOKING_DOWN, VGA
from lab.vision.parts import Case, Part, in_parts
from lab.vision.stills import SeedSet, target_named
from lab.vision.truth import PHOTOGRAPHS
from mkdaemon.vision.tags.detector import FIRST, Detector, looks_of
from mksim.scene.light import Glare, LightConditions, Shadow
from mksim.scene.motion import Platform
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView

Grey = npt.NDArray[np.uint8]

WHITELIST: Final = frozenset({1, 46, 48, 100, 200, 300, 373, 487})
"""Eight ids, as a generous user would allow; none of them is on the photographs, which show others."""
PHOTOGRAPH_EVERY: Final = 5
"""One image in so many is cut from a photograph, where there are any."""


def _plan(quick: bool, seeds: SeedSet) -> list[Part]:
    count = 500 if quick else 10_000
    return [Part(_tag_free, (seeds.base + 600, part, images), images) for part, images in in_parts(count, 125)]


def _tag_free(seed: int, part: int, count: int) -> tuple[Counter[str], int]:
    """Images by kind, and tags found in them by any search."""
    detector = Detector({"tag36h11": WHITELIST})
    images, false = Counter[str](), 0
    for name, pixels in grounds(seed, part, count, _photographs()):
        images[name] += 1
        false += sum(len(detector.search(pixels, *look)) for look in (*FIRST, *looks_of(*pixels.shape[::-1])))
        false += len(detector.search_all(pixels))
    return images, false


def grounds(seed: int, part: int, count: int, photographs: Sequence[Grey] = ()) -> Iterator[tuple[str, Grey]]:
    """Images of a ground without a target in every light, and parts of photographs between them, each with its kind."""
    rng = np.random.default_rng([seed, 0xFA15E, part])
    anchor = SceneTarget.of(target_named("single"), Platform())
    kind = GROUNDS[part % len(GROUNDS)]
    scene = Scene([anchor], ground=kind, seed=seed + part, fine=False)
    for k in range(count):
        if photographs and k % PHOTOGRAPH_EVERY == 0:
            yield "photograph", _cutting(rng, photographs)
        else:
            yield kind, scene.render(_view(rng), _conditions(rng))


def _view(rng: np.random.Generator) -> CameraView:
    """From 0.5 to 12 m over the ground, tilted, sometimes moving."""
    tilt = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3) + np.array([0, 0, float(rng.uniform(0, 6.28))]))[0]
    position = np.array([*rng.uniform(-4, 4, 2), float(rng.uniform(0.5, 12.0))])
    moves = rng.uniform() < 0.15
    return CameraView(
        VGA,
        np.asarray(tilt) @ LOOKING_DOWN.flu_from_cam,
        position,
        rng.uniform(-2, 2, 3) if moves else np.zeros(3),
        rng.uniform(-1, 1, 3) if moves else np.zeros(3),
        0.01 if moves else 0.0,
    )


def _conditions(rng: np.random.Generator) -> LightConditions:
    """Light, lens and sensor of a bad day; shadow and glare fall on the ground near the middle."""
    where = rng.uniform(-1.0, 1.0, (2, 2))
    shaded, shines, blurs, graded, coded = rng.uniform(size=5) < (0.35, 0.25, 0.1, 0.15, 0.15)
    return LightConditions(
        exposure=float(rng.uniform(0.3, 1.4)),
        noise_sd=float(rng.choice([1.5, 4.0, 15.0])),
        shadow=Shadow(
            float(rng.uniform(2, 8)), (float(where[0, 0]), float(where[0, 1])), float(rng.uniform(0, 6.28)), 0.0
        )
        if shaded
        else None,
        glare=(Glare((float(where[1, 0]), float(where[1, 1])), float(rng.uniform(0.02, 0.3)), 2.0),) if shines else (),
        defocus_px=float(rng.uniform(2, 6)) if blurs else 0.0,
        gradient=float(rng.uniform(2, 32)) if graded else 1.0,
        gradient_angle=float(rng.uniform(0, 6.28)),
        jpeg_quality=int(rng.integers(20, 90)) if coded else None,
        target_in_view=False,
    )


def _photographs() -> list[Grey]:
    """Photographs whose tags are not on the whitelist, where they are beside the checkout."""
    paths: list[Path] = sorted([*PHOTOGRAPHS.glob("apriltag/*.jpg"), *PHOTOGRAPHS.glob("rotation/*.png")])
    images = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths)
    return [np.asarray(image, dtype=np.uint8) for image in images if image is not None]


def _cutting(rng: np.random.Generator, photographs: Sequence[Grey]) -> Grey:
    """A turned, scaled part of a photograph with its own light and noise."""
    photograph = photographs[int(rng.integers(len(photographs)))]
    height, width = photograph.shape
    scale = float(np.exp(rng.uniform(np.log(0.8), np.log(3.0))))
    turn = cv2.getRotationMatrix2D(
        (float(rng.uniform(0, width)), float(rng.uniform(0, height))), float(rng.uniform(0, 360)), scale
    )
    turn[:, 2] += np.array([VGA.width, VGA.height]) / 2 - turn[:, :2] @ np.array([width, height]) / 2
    turned = cv2.warpAffine(
        photograph, turn, (VGA.width, VGA.height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    noise = rng.standard_normal(turned.shape, dtype=np.float32) * np.float32(rng.choice([1.0, 4.0, 10.0]))
    lit = turned.astype(np.float32) * np.float32(rng.uniform(0.4, 1.4)) + noise
    pixels: Grey = np.clip(np.rint(lit), 0, 255).astype(np.uint8)
    return pixels


def _sum_up(_quick: bool, _parts: Sequence[Part], found: Sequence[tuple[Counter[str], int]]) -> dict[str, Any]:
    images = sum((kinds for kinds, _ in found), Counter[str]())
    return {"images": images.total(), "by_kind": dict(images), "false_positives": sum(false for _, false in found)}


FALSE_POSITIVES: Final = Case(_plan, _sum_up)
"""Tag-free images: textured grounds and photographs in every light, every search of the detector, eight ids allowed."""
