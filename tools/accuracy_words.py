"""What the rows of docs/lab/accuracy.md are called: campaigns of the lab name them by their keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

Results = Mapping[str, Any]
"""docs/results/vision.json."""

WITH, WITHOUT = "eyes_with_attitude", "eyes_without"
NEAR, FAR = "to_4_m", "to_8_m"
"""Keys of the campaigns behind cameras: vision with and without attitude, by distance."""

CAMERAS: Final = {
    "ideal": "ideal",
    "gamma": "gamma 2.2",
    "low_light": "little light",
    "webcam": "webcam",
    "rolling": "rolling shutter",
    "webcam_rolling": "webcam, rolling shutter",
}
SKIES: Final = {
    "fair": "none",
    "sun_shadow": "sun and shadow",
    "leaf_shadows": "leaf shadows",
    "vehicle_shadow": "vehicle's shadow",
    "gloss": "gloss",
    "grass": "grass",
    "dark": "dusk, 6 % of the light",
    "exposure_18_ms": "exposure of 18 ms",
    "over_exposed": "over-exposed, 1.8 times",
    "dirty_lens": "dirty lens",
    "fringe": "colours 2 px apart in the corner",
    "curl": "bent print",
    "auto_exposure": "camera's own exposure under clouds, gamma 2.2",
}
TRIALS: Final = {
    "fog": "fog, 6 to 12 m of visibility",
    "rain": "drops on the lens",
    "propellers": "propellers, bent by the shutter",
    "lamps": "bands of dimmed lamps",
    "analog": "analog video",
    "analog_bad": "analog video, bad",
    "hand": "a hand over a side",
    "foot": "a foot over a side",
    "wide_lens": "lens of 120 degrees",
    "rolling_told": "rolling shutter that shakes, line time known",
    "rolling_untold": "the same, line time unknown",
}
LIES: Final = {
    "level": "right, the deck level",
    "tilted": "right, the deck tilted by 4 and 3 degrees",
    "rocking": "right, the deck rocking by 4 degrees",
    "attitude_biased": "roll off by 5 degrees",
    "attitude_jumps": "roll jumps by 6 degrees in flight",
    "roll_sign_swapped": "sign of roll swapped",
    "both_signs_swapped": "signs of roll and pitch swapped",
}
TROUBLES: Final = {
    "none": "none",
    "band": "covered side",
    "defocus": "defocus",
    "dim": "6-30 % of the light",
    "glare": "glare",
    "motion": "motion blur",
    "patches": "patches",
    "shadow": "shadow edge",
}
LEAVING: Final = {
    "nested_global": "nested, global",
    "nested_rolling": "nested, rolling",
    "single_global": "single, global",
    "single_rolling": "single, rolling",
    "whole": "together",
}
