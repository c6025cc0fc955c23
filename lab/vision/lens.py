"""A lens that differs from its calibration as far as a calibration may be wrong."""

from __future__ import annotations

import numpy as np

from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.pose import FLOOR_ANGLE, FLOOR_LATERAL, FLOOR_RANGE


def drawn_lens(lens: Intrinsics, rng: np.random.Generator) -> Intrinsics:
    """A lens whose calibration is another one: focal length .3 %, centre .2 % of the range, as the floor allows."""
    scale = 1.0 + FLOOR_RANGE * float(rng.standard_normal())
    shift = FLOOR_LATERAL * lens.fx * rng.standard_normal(2)
    return lens.model_copy(
        update={
            "fx": lens.fx * scale,
            "fy": lens.fy * scale,
            "cx": lens.cx + float(shift[0]),
            "cy": lens.cy + float(shift[1]),
            "k1": lens.k1 + float(FLOOR_ANGLE * rng.standard_normal()),
        }
    )
