"""Thresholds of what is done with a measured pose: gates, tracks, rivals, health; `limits.py` says how to read them."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

from mkdaemon.vision.limitfield import BLIND, EARNED, FLIGHTS, STILLS, of


@dataclass(frozen=True, slots=True)
class CertaintyLimits:
    """How uncertain a published pose may be."""

    angle_sd: float = of(radians(1.25), "rad", "beside an attitude", "derived: 4 deviations are 5 degrees")
    blind_angle_sd: float = of(radians(0.9), "rad", "without", BLIND)
    position_sd_m: float = of(0.0125, "m", "of the position", "derived: 4 deviations are 5 cm")
    position_share: float = of(0.0025, "share", "of the range, where that is more", "derived: 4 are 1 %")
    blind_rms_px: float = of(0.5, "px", "residual of an edge fit without attitude", BLIND)
    blind_grey_rms_px: float = of(0.4, "px", "of a grey-value fit, as shift of edges: 0.2-0.3 behind webcams", BLIND)


@dataclass(frozen=True, slots=True)
class InnovationLimits:
    """How far a pose may be from its prediction."""

    angle: float = of(radians(6.0), "rad", "turn beside an attitude: the gyro's error is left", FLIGHTS)
    blind_angle: float = of(radians(8.0), "rad", "without: shaking turns a camera by degrees", BLIND)
    angle_rate: float = of(radians(60.0), "rad/s", "and more by time since the last pose", FLIGHTS)
    range_share: float = of(0.01, "share", "of the range, for the range", FLIGHTS)
    range_speed: float = of(1.0, "m/s", "and more by time", "derived: 30 m/s^2 between two images")
    first_range_speed: float = of(6.0, "m/s", "the same before the velocity is known", FLIGHTS)
    place_share: float = of(0.05, "share", "of the range, for the lens in the target's frame", FLIGHTS)
    place_speed: float = of(4.0, "m/s", "and more by time", FLIGHTS)
    place_angle: float = of(0.35, "share", "and of the angle allowed times the range", FLIGHTS)


@dataclass(frozen=True, slots=True)
class AmbiguityLimits:
    """The choice between a pose and its mirror image."""

    same_pose: float = of(radians(1.0), "rad", "candidates closer are one pose", "below the published deviation")
    samples_per_fact: float = of(4.0, "", "neighbouring samples share pixels", "derived: blur over sample spacing")
    min_log_odds: float = of(12.0, "nats", "from which the image decides", "derived: one in 160,000")
    max_odds_against: float = of(2.0, "nats", "of the image against what the track chooses", BLIND)
    track_near: float = of(radians(5.0), "rad", "farthest from its prediction that a track chooses", BLIND)
    track_far: float = of(radians(2.0), "rad", "the rival must be twice as far and so much more", BLIND)
    harmless: float = of(radians(2.0), "rad", "closer rivals are published with the doubt in the covariance", BLIND)
    small_tilt: float = of(radians(0.3), "rad", "below, the mirrored pose is the pose", "a saddle at 1.5 deg, 5.5 off")
    asks_mirror: bool = of(True, "", "a first pose without a rival is asked for its mirror image", "0 flips in 8643")


@dataclass(frozen=True, slots=True)
class JudgeLimits:
    """What a track asks of a pose."""

    flow_through: int = of(5, "images", "missed, over which a prediction holds and optical flow finds its way", FLIGHTS)
    clear_bits: float = of(0.8, "correlation", "of cells that vouch for a late, hidden or undecoded pose", FLIGHTS)
    surprising: float = of(16.0, "", "squared distance from the course, not published", "chi-square(3), one in 900")
    asks_mirror2: float = of(4.0, "", "squared surprise of the attitude from which the mirror image is asked", BLIND)
    expected: float = of(9.0, "", "the same, inertia speaks for the pose", "chi-square(3), one in 34")
    backing_sd: float = of(radians(1.0), "rad", "of the predicted direction, for inertia to speak", BLIND)
    tilt_spread: float = of(radians(1.0), "rad", "of a pose that widens the attitude gate, at most", FLIGHTS)
    most_lean: float = of(
        radians(10.0), "rad", "of a level target by the attitude", "derived: 4 of the deck's deviations"
    )
    holds_tilt: bool = of(True, "", "a fit that fails is tried again with its tilt held level", EARNED)
    fuses_course: bool = of(True, "", "a pose takes in what inertia knew before it", EARNED)


@dataclass(frozen=True, slots=True)
class TrackLimits:
    """The memory of one target, and carrying its pose over by what moved in the image."""

    flow_min_points: int = of(8, "", "fewer fix no pose", "derived: four are needed, half may be wrong")
    flow_contrast: float = of(1e-7, "", "least eigenvalue of a window", "OpenCV's 1e-4 drops all at 6 % of the light")
    edge_px: float = of(4.0, "px", "corners nearer to the image edge are not followed", FLIGHTS)
    shake: float = of(0.08, "rad", "turn between two images within which it is looked for", FLIGHTS)
    alike: float = of(0.5, "correlation", "from which its image counts as found again", FLIGHTS)
    max_speed: float = of(8.0, "m/s", "camera against target; faster is a wrong pose", FLIGHTS)
    max_turn: float = of(radians(25.0), "rad", "between two images, that is continued", FLIGHTS)
    max_ahead: float = of(6.0, "steps", "over which a velocity is carried on", FLIGHTS)
    turn_ahead: float = of(1.5, "steps", "over which a turn is carried on: shaking turns back", FLIGHTS)
    forget_velocity: float = of(0.3, "s", "between poses that make no velocity", FLIGHTS)
    forget_misses: int = of(2, "images", "missed, after which a velocity is forgotten", FLIGHTS)
    max_gap: float = of(1.0, "s", "without an image, that ends a track", FLIGHTS)
    undecoded_grace: float = of(1.0, "s", "without a decoded tag beyond the re-detection period", FLIGHTS)
    blind_grace: float = of(5.0, "s", "the same with no whole tag in view, or backed by inertia", BLIND)
    retry_decode: float = of(0.1, "s", "between attempts to decode", "3 ms each: 3 % of a core")
    search_every: int = of(5, "images", "between searches for others while one is tracked", "cost: a search over five")
    decode_agrees: float = of(0.5, "cells", "between decoded corners and pose", "derived: half way to the next edge")


@dataclass(frozen=True, slots=True)
class BranchLimits:
    """Rival readings of a far target."""

    silent: float = of(3.0, "nats", "of one image that may be blur or light rather than tilt", BLIND)
    trusted_share: float = of(0.3, "share", "of the odds beyond: neighbouring images share faults", BLIND)
    max_image: float = of(6.0, "nats", "the most one image adds", BLIND)
    jump: float = of(10.0, "nats", "a jump off the course costs at most", BLIND)
    miss: float = of(6.0, "nats", "for taking all candidates of an image for wrong", BLIND)
    certain: float = of(25.0, "nats", "odds do not grow beyond: a wrong branch can be left", BLIND)
    decided: float = of(8.0, "nats", "from which the better branch is believed", "derived: one in 3,000")
    min_images: int = of(5, "images", "needed besides: two smeared ones may agree on nonsense", BLIND)
    overruled: float = of(0.5, "nats", "of the newest image against, that stop a publication", BLIND)
    remembered: float = of(0.9, "share", "of what images said against a branch, an image later", "a third of a second")
    same_direction: float = of(radians(3.5), "rad", "branches that see the target so are one answer", BLIND)
    differ_place: float = of(0.01, "share", "of the range, between places of branches that differ", BLIND)
    differ_speed: float = of(0.2, "1/s", "or of the range a second, between velocities", BLIND)


@dataclass(frozen=True, slots=True)
class HealthLimits:
    """Alarms of a camera, and doubts about its calibration or its target's file."""

    dark_grey: float = of(25.0, "grey", "the brightest percent of a usable image is above", STILLS)
    blown_share: float = of(0.5, "share", "of blown pixels in an over-exposed image", STILLS)
    frozen_images: int = of(3, "images", "identical in a row: a sensor's noise never repeats", "derived")
    large_tag_px: float = of(60.0, "px", "smaller tags say nothing about focus and calibration", FLIGHTS)
    drift_px: float = of(0.15, "px", "edge residual a right calibration does not leave", "0.03-0.1 in sharp images")
    misfit_share: float = of(0.02, "share", "of its side a tag may be off where its file puts it", STILLS)
    misfit_px: float = of(1.0, "px", "the same at least: corners are loose, lenses bend edges", STILLS)
    misfit_reach: float = of(3.0, "sides", "a tag farther from the largest one is not judged", STILLS)
    misfit_images: int = of(10, "images", "that contradict a target's file until it is reported", STILLS)
    agreement_px: float = of(1.5, "px", "corner residual above which tags contradict each other", STILLS)
    same_tag: float = of(0.5, "sides", "centres closer are one tag (stills)", "derived")
