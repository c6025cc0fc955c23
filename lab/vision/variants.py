"""The tracker with one part switched off, by the limits and settings it is given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from mkdaemon.config.vision import DetectorSection, TrackerSection
from mkdaemon.errors import ConfigError
from mkdaemon.vision.limits import LIMITS, Limits, SearchLimits

Kind = Literal["whole", "search", "fit", "gate", "memory"]
NEVER: Final = math.inf
ALWAYS_ANGLE: Final = math.pi
"""An angle nothing exceeds."""
KNOWN: Final = 1e-9
"""A deviation that leaves nothing unknown."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A tracker.

    Attributes:
        name: of what is switched off.
        kind: what it is.
        what: it does, in a few words.
        limits: with it switched off.
        tracker: settings with it switched off.
        detector: the same.
        is_flat: whether the target is taken for one that does not bend.
    """

    name: str
    kind: Kind
    what: str
    limits: Limits = LIMITS
    tracker: TrackerSection | None = None
    detector: DetectorSection | None = None
    is_flat: bool = False


def limits(**groups: dict[str, Any]) -> Limits:
    """The limits with some values of some groups changed."""
    changed = {group: replace(getattr(LIMITS, group), **values) for group, values in groups.items()}
    return replace(LIMITS, **changed)


def without_search(stage: str) -> Limits:
    """The limits with one search less, everywhere but where a followed target is decoded again."""
    search: SearchLimits = LIMITS.search
    ladder = tuple(one for one in search.ladder if one != stage)
    nearby = tuple(tuple(one for one in way if one != stage) for way in search.nearby)
    return replace(LIMITS, search=replace(search, ladder=ladder, nearby=nearby))


def settings(**values: Any) -> TrackerSection:
    """Settings beyond what a configuration file may say."""
    return TrackerSection.model_construct(**(TrackerSection().model_dump() | values))


WHOLE: Final = Variant("whole", "whole", "everything on")
VARIANTS: Final[tuple[Variant, ...]] = (
    Variant("search decimate1", "search", "full resolution", without_search("decimate1")),
    Variant("search log", "search", "logarithm of the grey values", without_search("log")),
    Variant("search halflog", "search", "logarithm at half the resolution", without_search("halflog")),
    Variant("search linear", "search", "light from grey values", without_search("linear")),
    Variant("search outline", "search", "broken outlines", without_search("outline")),
    Variant("search nearby", "search", "around a prediction", limits(search={"nearby": ((),)})),
    Variant("re-detection", "search", "decoding a followed tag again", tracker=settings(redetect_period=NEVER)),
    Variant(
        "photometric fit",
        "fit",
        "grey values of small and steep tags",
        limits(cells={"photometric_px": 0.0, "edges_up_to": ALWAYS_ANGLE}),
    ),
    Variant("all pixels", "fit", "grey values of a first pose and of its rivals", limits(cells={"small_px": 0.0})),
    Variant("second measure", "fit", "grey values that explain a first pose", limits(photo={"polish_match": 2.0})),
    Variant("mixed grey values", "fit", "grey values after edges, 4 to 5 px a cell", limits(cells={"mixed_px": 4.0})),
    Variant("melted edges", "fit", "grey values where edges melt", limits(cells={"melted_widths": 0.0})),
    Variant("joint prints", "fit", "grey values of several prints at once", limits(photo={"found_match": 2.0})),
    Variant("common shift", "fit", "an unknown that all edges share", limits(edges={"shift_sd_px": KNOWN})),
    Variant("own shift", "fit", "of a smaller tag's edges as an unknown", limits(edges={"own_shift_sd_px": KNOWN})),
    Variant("uneven light", "fit", "edges that growing light moves", limits(edges={"smooth_light": KNOWN})),
    Variant("bend", "fit", "of a print as an unknown", is_flat=True),
    Variant(
        "blown edges",
        "fit",
        "blur and contrast of blown edges as unknowns",
        limits(edges={"blur_share": KNOWN, "contrast_share": KNOWN, "unseen_contrast_share": KNOWN}),
    ),
    Variant("turning", "fit", "of a rolling shutter's camera as an unknown", limits(edges={"turning_sd": KNOWN})),
    Variant("held tilt", "fit", "the attitude in far and second fits", limits(judge={"holds_tilt": False})),
    Variant("glare mask", "fit", "leaving out what lies in a highlight", limits(read={"saturated": 256})),
    Variant("level fusion", "fit", "the attitude's tilt in the pose", tracker=settings(attitude_sd_deg=60.0)),
    Variant("course fusion", "memory", "inertia in the pose", limits(judge={"fuses_course": False})),
    Variant("backing", "memory", "inertia speaking for a pose", limits(judge={"expected": -1.0})),
    Variant("optical flow", "memory", "corners followed into the image", limits(track={"flow_min_points": 1000})),
    Variant("shift", "memory", "the target found again as a whole", limits(track={"alike": 2.0})),
    Variant("flow and shift", "memory", "both", limits(track={"flow_min_points": 1000, "alike": 2.0})),
    Variant("start shown", "memory", "asking the image before a start is fitted", limits(read={"start_match": -2.0})),
    Variant("coast", "memory", "looking for a lost target where it should be", tracker=settings(coast=0.0)),
    Variant("mirror of first", "gate", "asking a first pose for its mirror", limits(ambiguity={"asks_mirror": False})),
    Variant("evidence", "fit", "edges that support a partly hidden first pose", limits(evidence={"min_seen": 2.0})),
    Variant("points gate", "gate", "fewest that agree", tracker=settings(min_points=0)),
    Variant("clear cells", "gate", "that vouch for a tag in place of decoding it", limits(judge={"clear_bits": 2.0})),
    Variant("cells beside", "gate", "reading the print beside its place", limits(read={"beside_cells": 0})),
    Variant("inliers gate", "gate", "share that agrees", tracker=settings(min_inlier_fraction=0.0)),
    Variant("residual gate", "gate", "rms of what agrees", tracker=settings(max_rms_px=NEVER)),
    Variant("step gate", "gate", "fit at rest", tracker=settings(max_step=NEVER)),
    Variant("bits gate", "gate", "cells of the print", tracker=settings(min_bit_correlation=-2.0)),
    Variant("attitude gate", "gate", "roll and pitch", tracker=settings(attitude_gate_deg=180.0)),
    Variant(
        "innovation gate",
        "gate",
        "distance from the prediction",
        limits(innovation={"angle": NEVER, "blind_angle": NEVER, "range_share": NEVER, "place_share": NEVER}),
    ),
    Variant(
        "certainty gate",
        "gate",
        "its own covariance",
        limits(certainty={"angle_sd": NEVER, "blind_angle_sd": NEVER, "position_sd_m": NEVER}),
    ),
    Variant(
        "blind residual gate",
        "gate",
        "rms without attitude",
        limits(certainty={"blind_rms_px": NEVER, "blind_grey_rms_px": NEVER}),
    ),
    Variant("blind inliers gate", "gate", "0.6 without attitude", limits(agreement={"blind": 0.0})),
    Variant("whole inliers gate", "gate", "0.9 of a first pose", limits(agreement={"whole": 0.0})),
    Variant("smear gate", "gate", "no perspective in blurred images", limits(blur={"smeared_px": NEVER})),
    Variant("course gate", "gate", "distance from the course", limits(judge={"surprising": NEVER})),
    Variant("quiet zone", "gate", "white around a decoded tag", detector=DetectorSection(quiet_zone=False)),
    Variant("decision margin", "gate", "contrast of a decoded tag", detector=DetectorSection(min_decision_margin=0.0)),
)
"""Each with one part switched off."""


def variants_named(names: Sequence[str] | None) -> tuple[Variant, ...]:
    """The variants with these names; all when none is given.

    Raises:
        ConfigError: there is no such variant.
    """
    known = {variant.name: variant for variant in VARIANTS}
    for name in names or ():
        if name not in known:
            msg = f"--only '{name}': no such part, use some of {', '.join(known)}"
            raise ConfigError(msg)
    return tuple(known[name] for name in names) if names else VARIANTS
