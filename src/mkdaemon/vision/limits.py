"""Every threshold of the eyes: value, unit, meaning, and where the figure comes from.

Those a user may set stand in `mkdaemon.config.vision`. "Tuned" is chosen by hand on development scenes of
`python -m lab vision` (docs/accuracy.md); what gates and parts earn is measured with `--ablate` (docs/vision.md).
Shares are 0 to 1, deviations are standard deviations, widths of edges are half widths. Constants of a numeric method
(steps, damping, convergence, process noise) stand beside the method.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final, Literal

from mkdaemon.vision.limitfield import BLIND, EARNED, FLIGHTS, NOISE, STILLS, of

Stage = Literal["decimate2", "decimate1", "log", "linear", "equalised", "outline", "thorough"]
"""A way to search an image for tags."""

LADDER: Final[tuple[Stage, ...]] = ("decimate2", "linear", "decimate1", "log", "equalised", "outline")
NEARBY: Final[tuple[tuple[Stage, ...], ...]] = (("decimate1",), ("linear", "log", "equalised"))


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """Finding tags in an image."""

    ladder: tuple[Stage, ...] = of(LADDER, "", "searches of the whole image; two in turn, others beside", EARNED)
    nearby: tuple[tuple[Stage, ...], ...] = of(NEARBY, "", "around a prediction, in turn by images missed", EARNED)
    max_pixels: int = of(500_000, "px", "searched at once; more are shrunk", "cost: 9 ms on VGA, 1080p 33 % of that")
    thorough_every: int = of(2, "images", "between the searches beside the first one", "cost: 20 ms on VGA")
    tile_px: float = of(70.0, "px", "neighbourhood in which `equalised` spreads grey values", STILLS)
    tone: float = of(1.8, "power", "of grey that `linear` takes for light", "decodes at gamma 1 to 2.2, 6-8 m")
    small_tag_px: float = of(46.0, "px", "side below which two corner sets are averaged", "rms .12 for .15 px, stills")
    twin_px: float = of(4.0, "px", "detections closer than this are one tag", "derived: half of a small tag's side")
    min_window_px: int = of(16, "px", "smaller parts of an image are not searched", "derived: 2 px a cell")
    full_contrast: float = of(60.0, "grey", "range from which the decision margin counts in full", STILLS)


@dataclass(frozen=True, slots=True)
class ReadLimits:
    """Reading the cells of a known print."""

    saturated: int = of(253, "grey", "a pixel from here up may have been anything", NOISE)
    quiet_share: float = of(0.5, "share", "samples of a side that must be white outside, black inside", STILLS)
    quiet_contrast: float = of(0.15, "share", "of the usual contrast, for such a sample", STILLS)
    quiet_grey: float = of(3.0, "grey", "the same at least", NOISE)
    min_cells: int = of(16, "", "fewer cells tell nothing", "derived: one in 65,000 by chance")
    paper_share: float = of(0.2, "share", "unsaturated white cells that make saturated ones a highlight", STILLS)
    rise: float = of(0.1, "share", "of the mean rise between neighbours from which a rise counts", STILLS)
    rise_grey: float = of(2.0, "grey", "the same at least", NOISE)


@dataclass(frozen=True, slots=True)
class OutlineLimits:
    """The search for tags with a broken outline."""

    min_side_px: float = of(40.0, "px", "smaller tags are left to libapriltag: pieces are too short", STILLS)
    straight_px: float = of(1.6, "px", "deviation of pieces from their line", STILLS)
    min_piece_px: int = of(8, "px", "shorter pieces have no direction", STILLS)
    parallel: float = of(0.98, "cosine", "between pieces that may be one line", STILLS)
    min_support: float = of(0.6, "share", "of a quad's perimeter that is outline", STILLS)
    min_side_support: float = of(0.3, "share", "the same for each side", STILLS)
    min_sine: float = of(0.2, "sine", "between neighbouring sides", STILLS)
    level: float = of(0.2, "share", "of the contrast within which a cell is black or white", STILLS)
    min_contrast: float = of(20.0, "grey", "between paper and border", STILLS)
    max_chance: float = of(4e-6, "probability", "that a random quad reads so well", "0 false in 10,000 images")


@dataclass(frozen=True, slots=True)
class CellSizes:
    """Side of a cell in the image from which something can be told; smaller is farther."""

    readable_px: float = of(2.5, "px", "smaller cells have no edge, corner or grey value of their own", EARNED)
    photometric_px: float = of(4.0, "px", "smaller cells are fitted by grey values", EARNED)
    small_px: float = of(10.0, "px", "below, all pixels of a first pose tell more than its edges", EARNED)
    perspective_px: float = of(24.0, "px", "from here perspective tells a pose from its mirror image", BLIND)
    edges_up_to: float = of(radians(60.0), "rad", "tilt from which edges run into each other", "steep stills")


@dataclass(frozen=True, slots=True)
class Agreement:
    """Share of a fit's measurements that agree with it; `TrackerSection.min_inlier_fraction` is the least."""

    blind: float = of(0.6, "share", "without an attitude that could contradict", BLIND)
    whole: float = of(0.9, "share", "where nothing lies over the target; a faked border leaves fewer", EARNED)
    power: int = of(
        4, "", "variance over share**power: what hid some points touches others", "a wrong pose, set 17 million"
    )
    floor: float = of(0.3, "share", "smaller ones count as this in the power", "below the least that passes")


@dataclass(frozen=True, slots=True)
class BlurWidths:
    """Half width of edges in the image."""

    sharp_px: float = of(1.75, "px", "in focus and at rest", "rendered images, point spread 0.6 px")
    wide_px: float = of(3.0, "px", "from here the shape of the blur moves edges", "NEES beyond 3 m")
    smeared_px: float = of(3.5, "px", "from here perspective drowns in blur; at 3.0 1 % fewer poses", BLIND)
    alarm_px: float = of(5.0, "px", "from here motion or focus is at fault", STILLS)


@dataclass(frozen=True, slots=True)
class EdgeLimits:
    """The fit of a pose to edges."""

    reach_px: tuple[float, ...] = of((24.0, 6.0, 3.0, 2.5), "px", "along the normal, by iteration", FLIGHTS)
    reach_cells: float = of(0.5, "cells", "the same", "derived: half way to the neighbouring edge")
    min_samples: int = of(12, "", "fewer edges fix no pose", "derived: twice the unknowns")
    max_samples: int = of(320, "", "more cost time without improving the pose", STILLS)
    max_move: float = of(0.2, "share", "of the range; a fit that moves farther ran away", FLIGHTS)
    max_move_m: float = of(0.02, "m", "and so much more (edges only)", FLIGHTS)
    settled_px: float = of(0.08, "px", "a step that moves samples less ends the fit", "below a located edge's error")
    tukey: float = of(4.685, "deviations", "outlier bound", "95 % efficiency; Holland and Welsch 1977")
    counted: float = of(0.1, "weight", "from which a sample agrees", "derived: 83 % of the outlier bound")
    first_scale_px: float = of(0.15, "px", "least deviation believed in the first iteration", FLIGHTS)
    least_scale_px: float = of(0.02, "px", "and in later ones", "least residual of rendered edges")
    located_px: float = of(0.3, "px", "edge error in a bad image, to weigh prior knowledge", FLIGHTS)
    min_peak: float = of(0.15, "share", "of the steep edges' slope that an edge needs", STILLS)
    min_slope: float = of(2.5, "grey", "the same at least, over two samples", NOISE)
    glare_px: float = of(2.0, "px", "reach of a highlight beside an edge that hides it", STILLS)
    blown_share: float = of(0.5, "share", "of blown bright sides from which the paper is blown", STILLS)
    missed_px: float = of(0.6, "px", "cost of a sample without its edge when rivals compare", BLIND)
    shift_sd_px: float = of(0.2, "px", "of a common shift of all edges (tone curve, ink)", "0.3-0.4 px, webcams")
    turning_sd: float = of(1.0, "rad/s", "of the camera while a rolling shutter reads", "shaking is 0.4 rad/s")
    climbing_sd: float = of(2.0, "m/s", "along the optical axis, where no track knows it", "as of a first velocity")
    unknown_speed: float = of(1.0, "m/s", "across the line of sight, where no track knows it", FLIGHTS)
    known_turning_sd: float = of(0.2, "rad/s", "of the turning between two attitudes 20 ms apart", "noise .1 deg each")
    known_climbing_sd: float = of(0.1, "m/s", "along the optical axis, where a track knows it", FLIGHTS)
    systematic_px: float = of(0.01, "px", "interpolation error that does not average out", "noise-free stills")


@dataclass(frozen=True, slots=True)
class PhotoLimits:
    """The fit of a pose to grey values."""

    min_window_px: int = of(6, "px", "smaller prints show nothing", STILLS)
    max_window_px: int = of(160, "px", "larger prints have edges, and pixels that cost time", STILLS)
    outlier: float = of(4.0, "deviations", "from which a pixel loses weight", STILLS)
    counted: float = of(0.5, "weight", "from which a pixel agrees", "derived: 5.7 deviations")
    quiet_grey: float = of(2.0, "grey", "residuals below are equally good when rivals compare", NOISE)
    lost_grey: float = of(60.0, "grey", "residuals above are equally bad", BLIND)
    margin_cells: float = of(0.3, "cells", "rim of the quiet zone that is left out", STILLS)
    polish_match: float = of(0.95, "correlation", "of model and image where the model holds", STILLS)
    same_mahalanobis2: float = of(22.5, "", "farther apart two fits contradict each other", "chi-square(6), 1 in 1000")


@dataclass(frozen=True, slots=True)
class EvidenceLimits:
    """The edges of a partly hidden first pose, without attitude."""

    seen_contrast: float = of(0.5, "share", "of the clear edges' contrast from which one is seen", STILLS)
    least_scale_px: float = of(0.1, "px", "located edges scatter at least so much", STILLS)
    outlier: float = of(4.0, "deviations", "from which an edge disagrees", STILLS)
    min_agreeing: float = of(0.9, "share", "of seen edges that a right pose explains", "0.94 and more, development")
    min_seen: float = of(0.4, "share", "of the edges in view that is seen", STILLS)
    max_leverage: float = of(radians(0.4), "rad", "turn by one line of edges", "right < 0.3, wrong > 0.48 deg")


@dataclass(frozen=True, slots=True)
class CertaintyLimits:
    """How uncertain a published pose may be."""

    angle_sd: float = of(radians(1.25), "rad", "beside an attitude", "derived: 4 deviations are 5 degrees")
    blind_angle_sd: float = of(radians(0.9), "rad", "without", BLIND)
    position_sd_m: float = of(0.0125, "m", "of the position", "derived: 4 deviations are 5 cm")
    position_share: float = of(0.0025, "share", "of the range, where that is more", "derived: 4 are 1 %")
    blind_rms_px: float = of(0.5, "px", "residual of an edge fit without attitude", BLIND)
    blind_grey_rms_px: float = of(0.4, "px", "of a grey-value fit, as shift of edges: 0.2-0.3 behind webcams", BLIND)
    wide_factor: float = of(1.7, "factor", "on a position's deviation from wide edges", "95 % of NEES below 4.4")


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
    clear_ratio: float = of(1.4, "", "residual ratio that decides with clear odds", BLIND)
    clear_log_odds: float = of(48.0, "nats", "asked for at that ratio: light and blur are shared", BLIND)
    max_odds_against: float = of(2.0, "nats", "of the image against what the track chooses", BLIND)
    track_near: float = of(radians(5.0), "rad", "farthest from its prediction that a track chooses", BLIND)
    track_far: float = of(radians(2.0), "rad", "the rival must be twice as far and so much more", BLIND)
    harmless: float = of(radians(2.0), "rad", "closer rivals are published with the doubt in the covariance", BLIND)
    small_tilt: float = of(radians(1.5), "rad", "below, the mirrored pose is the pose", BLIND)
    asks_mirror: bool = of(True, "", "a first pose without a rival is asked for its mirror image", "0 flips in 8643")


@dataclass(frozen=True, slots=True)
class JudgeLimits:
    """What a track asks of a pose."""

    flow_through: int = of(5, "images", "missed, over which optical flow finds its way", FLIGHTS)
    clear_bits: float = of(0.8, "correlation", "of cells that vouch for a late, hidden or undecoded pose", FLIGHTS)
    surprising: float = of(16.0, "", "squared distance from the course, not published", "chi-square(3), one in 900")
    expected: float = of(9.0, "", "the same, inertia speaks for the pose", "chi-square(3), one in 34")
    backing_sd: float = of(radians(1.0), "rad", "of the predicted direction, for inertia to speak", BLIND)
    tilt_spread: float = of(radians(1.0), "rad", "of a pose that widens the attitude gate, at most", FLIGHTS)
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
    predict_through: int = of(18, "images", "missed, over which a prediction with attitude holds", FLIGHTS)
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


@dataclass(frozen=True, slots=True)
class Limits:
    """All of them; the ablation campaign hands others to the tracker."""

    search: SearchLimits = SearchLimits()
    read: ReadLimits = ReadLimits()
    outline: OutlineLimits = OutlineLimits()
    cells: CellSizes = CellSizes()
    agreement: Agreement = Agreement()
    blur: BlurWidths = BlurWidths()
    edges: EdgeLimits = EdgeLimits()
    photo: PhotoLimits = PhotoLimits()
    evidence: EvidenceLimits = EvidenceLimits()
    certainty: CertaintyLimits = CertaintyLimits()
    innovation: InnovationLimits = InnovationLimits()
    ambiguity: AmbiguityLimits = AmbiguityLimits()
    judge: JudgeLimits = JudgeLimits()
    track: TrackLimits = TrackLimits()
    branches: BranchLimits = BranchLimits()
    health: HealthLimits = HealthLimits()


LIMITS: Final = Limits()
