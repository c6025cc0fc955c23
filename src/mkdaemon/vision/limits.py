"""Every threshold of vision: value, unit, meaning, and where the figure comes from.

Those a user may set stand in `mkdaemon.config.vision`, constants of a numeric method (steps, damping, convergence,
process noise) beside the method. Shares are 0 to 1, deviations are standard deviations, widths of edges are half
widths. "Tuned" is chosen by hand on development scenes of `python -m lab vision` (docs/lab/accuracy.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import Any, Final

FLIGHTS: Final = "tuned on development flights"
STILLS: Final = "tuned on development stills"
BLIND: Final = "tuned on development flights without attitude"
NOISE: Final = "derived from read noise of 1.5 grey"
EARNED: Final = "measured, docs/lab/vision-cases.md"
MEASURED: Final = "measured, docs/lab/accuracy.md"
APART2: Final = 22.5
"""Squared distance of two poses in their deviations that no noise makes: chi-square(6), one in 1000."""
HALF: Final = 0.5
"""Of many, what the majority does; of a cell, half way to the next edge; of a contrast, neither of both."""
NOISE_GREY: Final = 2.0
"""Differences below say nothing: derived from read noise of 1.5 grey [grey]."""


def of(value: Any, unit: str, meaning: str, source: str) -> Any:
    """Declare a limit; unit, meaning and source can be read from the field's metadata."""
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "source": source})


@dataclass(frozen=True, slots=True)
class CertaintyLimits:
    """Largest uncertainty of a published pose."""

    deviations: float = of(4.0, "deviations", "of a published pose beside an attitude are not wrong", "one in 16,000")
    blind_deviations: float = of(5.5, "deviations", "without: 0.9 degrees", BLIND)
    wrong_angle: float = of(radians(5.0), "rad", "from which a pose is wrong", "a landing over a deck")
    wrong_m: float = of(0.05, "m", "the same of its place", "a landing gear")
    wrong_share: float = of(0.01, "share", "of the range, a size", "what a calibration leaves, three times")
    blind_rms_px: float = of(0.5, "px", "residual without attitude, as shift of edges: 0.2-0.3 behind webcams", BLIND)

    @property
    def angle_sd(self) -> float:
        """Largest deviation of an angle of a pose beside an attitude [rad]."""
        return self.wrong_angle / self.deviations

    @property
    def blind_angle_sd(self) -> float:
        """Largest deviation of an angle without attitude, or of a direction by inertia; closer is one pose [rad]."""
        return self.wrong_angle / self.blind_deviations


@dataclass(frozen=True, slots=True)
class AmbiguityLimits:
    """The choice between rival poses, as one and its mirror image."""

    samples_per_fact: float = of(4.0, "", "neighbouring samples share pixels", "derived: blur over sample spacing")
    decided: float = of(8.0, "nats", "from which a reading is used, by images", "derived: one in 3,000")
    silent: float = of(3.0, "nats", "of one image that may be blur or light rather than tilt", BLIND)
    remembered: float = of(0.9, "share", "of what images said against a branch, an image later", "a third of a second")


@dataclass(frozen=True, slots=True)
class HealthLimits:
    """Alarms of a camera, and doubts about its calibration or its target's file."""

    dark_grey: float = of(25.0, "grey", "the brightest percent of a usable image is above", STILLS)
    frozen_images: int = of(3, "images", "identical in a row: a sensor's noise never repeats", "derived")
    large_tag_px: float = of(60.0, "px", "smaller tags say nothing about focus and calibration", FLIGHTS)
    drift_px: float = of(0.15, "px", "residual of edges that nothing unmodelled leaves", "0.03-0.1 in sharp images")
    misfit_share: float = of(0.02, "share", "of its side a tag may be off where its file puts it", STILLS)
    misfit_px: float = of(1.0, "px", "the same at least, of corners: they are loose, lenses bend edges", STILLS)
    misfit_reach: float = of(3.0, "sides", "a tag farther from the largest one is not judged", STILLS)
    misfit_images: int = of(10, "images", "that contradict a target's file until it is reported", STILLS)


@dataclass(frozen=True, slots=True)
class SelfCalLimits:
    """Conditions for the use of an image, and for the report of a difference."""

    period: float = of(0.09, "s", "between images that are looked at", "cost: 1.2 ms each")
    settled: float = of(0.0065, "share", "deviation of a focal length that little more will move", MEASURED)
    settled_certain: float = of(3.0, "deviations", "from which such a focal length is reported", MEASURED)
    centre_px: float = of(4.0, "px", "of the principal point", "1.5 cm at 4 m")
    k1: float = of(0.02, "", "of the radial distortion", "0.5 cm at 2 m")
    mounting: float = of(radians(1.0), "rad", "of the mounting; less is the attitude's own bias", "sim: 0.5-1.5 deg")
    sheet: float = of(0.05, "share", "of the focal length against the data sheet's", "tolerances, docs/cameras.md")


SELFCAL: Final = SelfCalLimits()


@dataclass(frozen=True, slots=True)
class ExposureLimits:
    """Wanted brightness of an image, and speed of the settings."""

    contrast: float = of(20.0, "noises", "between black and white cells", "decoded from 5, docs/cameras.md")
    white: float = of(150.0, "grey", "of white cells: room for the sun and for noise", "chosen: half of 300")
    step: float = of(2.0, "", "greatest change of exposure and of gain at once", "chosen: a tag is read after it")
    same: float = of(0.1, "share", "of a change that is not worth one", "chosen")
    images: int = of(5, "images", "from one change to the next look", "sensors take settings 2-3 images late")


EXPOSURE: Final = ExposureLimits()


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """Finding tags in an image, and a target again from one image to the next."""

    max_pixels: int = of(500_000, "px", "searched at once; more are shrunk", "cost: 9 ms on VGA, 1080p 33 % of that")
    thorough_every: int = of(2, "images", "between the searches beside the first one", "cost: 20 ms on VGA")
    tone: float = of(1.8, "power", "of grey that `linear` takes for light", "decodes at gamma 1 to 2.2, 6-8 m")
    min_window_px: int = of(16, "px", "smaller parts of an image are not searched", "derived: 2 px a cell")
    beside_every: int = of(5, "images", "between searches beside a track: others, its own tag", "cost: 3 ms and more")
    shake: float = of(0.08, "rad", "turn between two images within which a target is looked for", FLIGHTS)


@dataclass(frozen=True, slots=True)
class ReadLimits:
    """Reading the cells of a known print."""

    saturated: int = of(253, "grey", "a pixel from here up may have been anything", NOISE)
    nearly_blown: float = of(3.0 * NOISE_GREY, "grey", "below `saturated` noise decides: two deviations of ink", NOISE)
    least_contrast: float = of(0.15, "share", "of the usual contrast, or slope, of an edge", STILLS)
    misread: float = of(0.05, "share", "of neighbouring cells in view, where the print is", STILLS)
    beside_cells: int = of(3, "cells", "that a fit may lie beside its place", "nested targets; farther fails the bits")
    faint: float = of(0.1, "share", "of a contrast, by which light may change in a cell", "0.05 to 0.2: as many tags")
    max_chance: float = of(1e-6, "probability", "that a random quad reads so well", "none in 1,000 images allow 2e-5")
    least_side: float = of(0.3, "share", "of a side of a print that its outline shows", "rims of highlights show 0.2")
    rise: float = of(20.0, "grey", "step of an edge in a highlight; no more of it counts", "10: 10 of 280 tags less")


@dataclass(frozen=True, slots=True)
class CellSizes:
    """Side of a cell in the image from which it is evidence; smaller is farther."""

    readable_px: float = of(2.5, "px", "smaller cells have no separate edge, corner or grey value", EARNED)
    photometric_px: float = of(4.0, "px", "smaller cells are fitted by grey values", EARNED)
    melted_widths: float = of(3.0, "half widths", "of its edges: smaller cells melt", "5 px where sharp: 1.75 px")
    perspective_px: float = of(24.0, "px", "from here perspective tells a tilt, whatever is hidden", BLIND)
    edges_up_to: float = of(radians(60.0), "rad", "tilt from which edges run into each other", "steep stills")

    @property
    def mixed_px(self) -> float:
        """Below, grey values come first, and edges where these fail; from here half an image is still read [px]."""
        return 2.0 * self.readable_px

    @property
    def small_px(self) -> float:
        """Below, all pixels of a first pose tell more than its edges: an edge is within two readable cells [px]."""
        return 4.0 * self.readable_px


@dataclass(frozen=True, slots=True)
class Agreement:
    """Share of a fit's measurements that agree with it; `TrackerSection.min_inlier_fraction` is the least."""

    blind: float = of(0.6, "share", "without an attitude that could contradict", BLIND)
    whole: float = of(0.9, "share", "of a target, or its seen edges, without a cover; a faked border: fewer", EARNED)
    power: int = of(4, "", "images in a row share variance over share**power", "a wrong pose, set 17 million")


@dataclass(frozen=True, slots=True)
class Likeness:
    """Correlation of a print, its cells or its image with what an image shows."""

    alike: float = of(0.35, "correlation", "of a start that leads to its place", "0.34 and more, development")
    clear: float = of(0.75, "correlation", "of cells or a print that vouch for a pose", FLIGHTS)
    explained: float = of(0.95, "correlation", "of model and image where the model holds", STILLS)


@dataclass(frozen=True, slots=True)
class BlurWidths:
    """Half width of edges in the image."""

    sharp_px: float = of(1.75, "px", "no edge is taken for narrower", "1.9-2.1 in focus at rest, 1.75 cut by clipping")
    smeared_px: float = of(3.5, "px", "from here the shape of the blur moves edges, perspective drowns in it", BLIND)
    alarm_px: float = of(5.0, "px", "from here motion or focus is at fault", STILLS)


@dataclass(frozen=True, slots=True)
class EdgeLimits:
    """The fit of a pose to edges."""

    reach_px: tuple[float, ...] = of((24.0, 6.0, 3.0, 2.5), "px", "along the normal, by iteration", FLIGHTS)
    max_samples: int = of(320, "", "more cost time without improving the pose", STILLS)
    max_move: float = of(0.2, "share", "of the range; a fit that moves farther ran away", FLIGHTS)
    settled_px: float = of(0.08, "px", "a step that moves samples less ends the fit", "below a located edge's error")
    tukey: float = of(4.685, "deviations", "outlier bound", "95 % efficiency; Holland and Welsch 1977")
    counted: float = of(0.1, "weight", "from which a sample agrees", "derived: 83 % of the outlier bound")
    least_scale_px: float = of(0.02, "px", "least deviation of edges", "least residual of rendered edges")
    located_px: float = of(0.3, "px", "edge error in a bad image, to weigh prior knowledge", FLIGHTS)
    max_leverage: float = of(radians(0.4), "rad", "turn by one line of edges", "right < 0.3, wrong > 0.48 deg")
    clipped_sd: float = of(0.4, "share", "of blur and contrast of blown edges", "derived: 1.2 to 1.7 of what shows")
    shift_sd_px: float = of(0.2, "px", "of a common shift of all edges (tone curve, ink)", "0.3-0.4 px, webcams")
    turning_sd: float = of(1.0, "rad/s", "of the camera while a rolling shutter reads", "shaking is 0.4 rad/s")
    acceleration_sd: float = of(15.0, "rad/s^2", "of the camera's turning then", "0.4 rad/s that change in 30 ms")
    speed_sd: float = of(2.0, "m/s", "of a camera whose velocity no track knows, each way", FLIGHTS)
    attitude_noise: float = of(radians(0.1), "rad", "of one reported attitude, each axis", "its last digit is .1 deg")

    @property
    def systematic_px(self) -> float:
        """Error of interpolation, which no number of samples averages out: half the residual of noise-free edges."""
        return HALF * self.least_scale_px


@dataclass(frozen=True, slots=True)
class PhotoLimits:
    """The fit of a pose to grey values."""

    min_window_px: int = of(6, "px", "smaller prints show nothing", STILLS)
    max_window_px: int = of(160, "px", "larger prints have edges, and pixels that cost time", STILLS)
    margin_cells: float = of(0.3, "cells", "rim of the quiet zone that is left out", STILLS)
    lost_grey: float = of(60.0, "grey", "residuals above are equally bad", BLIND)


@dataclass(frozen=True, slots=True)
class VisionLimits:
    """All of them."""

    search: SearchLimits = field(default_factory=SearchLimits)
    read: ReadLimits = field(default_factory=ReadLimits)
    cells: CellSizes = field(default_factory=CellSizes)
    likeness: Likeness = field(default_factory=Likeness)
    agreement: Agreement = field(default_factory=Agreement)
    blur: BlurWidths = field(default_factory=BlurWidths)
    edges: EdgeLimits = field(default_factory=EdgeLimits)
    photo: PhotoLimits = field(default_factory=PhotoLimits)
    certainty: CertaintyLimits = field(default_factory=CertaintyLimits)
    ambiguity: AmbiguityLimits = field(default_factory=AmbiguityLimits)
    health: HealthLimits = field(default_factory=HealthLimits)


LIMITS: Final = VisionLimits()
