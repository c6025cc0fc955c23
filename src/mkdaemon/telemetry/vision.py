"""Vision: tags, poses, quality, and the tree of frames.

Camera axes are right, down, forward; body is forward, left, up; a target has x to the right and y to the top of its
print and z out of the paper. Stamps of what was seen are of the exposure's middle.
"""

from enum import StrEnum

from pydantic import Field

from mkdaemon.telemetry.base import Stamped, Telemetry
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.telemetry.tone import Tone, ToneEnum

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Pixel = tuple[float, float]


class Seen(Stamped):
    """Which image a value comes from."""

    camera: str
    """Name of the camera."""
    sequence: int
    """Number of the image; a gap is a lost image."""
    stamped_by: str
    """Source of the stamp of mid exposure: `driver`, `header` or `arrival`."""


class TagSighting(Telemetry):
    """One decoded tag."""

    family: str
    """For example `tag36h11`."""
    id: int
    """Its code."""
    hamming: int
    """Bits corrected."""
    decision_margin: float
    """Mean distance of the bits from the threshold [grey levels]."""
    corners: tuple[Pixel, Pixel, Pixel, Pixel]
    """Top-left, top-right, bottom-right, bottom-left of the official print [px, centres at integers]."""
    search: str
    """Which search found it."""


class Tags(Seen):
    """Every tag decoded in an image: `vision/<camera>/tags`. Images that are tracked without decoding have none."""

    tags: tuple[TagSighting, ...]
    """The tags."""


REPORTED = "report"
"""`source` of a pose that a source of poses measured."""


class VisionPose(Seen):
    """Pose of the vehicle relative to a target: `vision/<camera>/pose`, one value a target and image."""

    target: str
    """Name of the target."""
    position_target: Vector3
    """Vehicle (body origin) in the target frame [m]."""
    quaternion_target_from_flu: Quaternion
    """Attitude of the vehicle in the target frame (w, x, y, z)."""
    position_flu: Vector3
    """Target's origin in the body frame [m]."""
    quaternion_flu_from_target: Quaternion
    """The inverse rotation (w, x, y, z)."""
    covariance: tuple[float, ...]
    """Of the vehicle's pose, `(6, 6)` by rows over position and rotation vector, target axes [m2] [m rad] [rad2]; what
    a calibration cannot know is included."""
    calibration_sd: Vector3 = (0.0, 0.0, 0.0)
    """What all images of this camera have in common of that, because its calibration does not know it: standard
    deviations along the line of sight [m], across it [m], and of the angle [rad]."""
    position_cam: Vector3
    """Target's origin as the camera measured it [m; RDF]."""
    quaternion_cam_from_target: Quaternion
    """Target's rotation as the camera measured it (w, x, y, z)."""
    source: str
    """How it was measured: `corners`, `edges`, `photometric`; `report`: by a source of poses."""
    mode: str
    """How it was found: `predicted`, `flow`, `roi`, `search`."""
    points: int
    """Measurements that agree."""
    rms_px: float
    """Their residual [px]."""
    ambiguity: float | None
    """Residual of the mirrored pose over this one; none where there is no rival, or none was looked for."""
    decided_by: str
    """What decided between them: `unique` (no rival, or perspective), `image`, `attitude`, `track` (images before)."""
    decode_age: float
    """Time since a tag of the target was last decoded [s]."""
    delivered: float
    """From the middle of the exposure until the camera had delivered the image [s]."""
    latency: float
    """From the middle of the exposure to this value [s]."""
    is_of_map: bool = False
    """The target is a map, or a place on one: its tags lie around the vehicle, however that leans."""

    @property
    def is_placed(self) -> bool:
        """Whether a source of poses measured the place of the vehicle in the target frame, whatever its attitude.

        A camera measures where the target lies in the body frame. What only an image has is empty then.
        """
        return self.source == REPORTED


class PoseRefusal(StrEnum):
    """Reason for which a measured pose is not published."""

    NO_FIT = "no_fit"
    """No fit came to an end near its start."""
    INLIERS = "inliers"
    """Too few of the measurements agree."""
    POINTS = "points"
    """Too few measurements."""
    RESIDUAL = "residual"
    """What agrees does so badly, or worse than usual."""
    STEP = "step"
    """The fit had not come to rest."""
    BITS = "bits"
    """The image does not show the target's cells there."""
    ATTITUDE = "attitude"
    """Roll and pitch of the vehicle contradict."""
    ANGLE_UNCERTAIN = "angle_uncertain"
    """Its own covariance allows for a wrong angle."""
    POSITION_UNCERTAIN = "position_uncertain"
    """Its own covariance allows for a wrong position."""
    AMBIGUOUS = "ambiguous"
    """Nothing tells it from its mirror image."""
    OFF_COURSE = "off_course"
    """No vehicle gets there from where it was."""
    DECODED_ELSEWHERE = "decoded_elsewhere"
    """A tag of the target was decoded in another place."""
    NOT_DECODED = "not_decoded"
    """None of its tags was decoded for too long."""
    MALFORMED = "malformed"
    """A report of a source of poses cannot be read, or is no pose."""
    UNSIGNED = "unsigned"
    """The owner of the source's secret did not sign it."""
    LATE = "late"
    """It is older than `max_age` of the source."""
    OUT_OF_ORDER = "out_of_order"
    """A newer one came before."""
    REPEATED = "repeated"
    """It has the very numbers of the one before: nothing was measured."""
    MOTION = "motion"
    """The source shows another motion than the boards."""
    DISPUTED = "disputed"
    """Another source shows another place, and nothing has shown yet which is wrong."""


class PoseRefused(Seen):
    """An image that shows a target and gave no pose: `vision/<camera>/refused`, one value a target and image."""

    target: str
    """Name of the target."""
    refusal: PoseRefusal
    """The first check that the measured pose failed."""
    decode_age: float | None
    """Time since a tag of the target was last decoded [s], 0 in this image; None while it must be searched."""
    has_attitude: bool
    """Whether an attitude of the vehicle was used for this image."""


class Alarm(StrEnum):
    """Fault of a camera's images, its calibration or its target's file."""

    WRONG_SIZE = "wrong_size"
    WRONG_KIND = "wrong_kind"
    """Images that are not 8-bit grey values."""
    UNCALIBRATED = "uncalibrated"
    FROZEN = "frozen"
    DAMAGED = "damaged"
    DARK = "dark"
    BLOWN = "blown"
    BLURRED = "blurred"
    RESIDUAL_DRIFT = "residual_drift"
    TARGET_MISMATCH = "target_mismatch"
    SCALE = "scale"
    """A size or the focal length contradicts other evidence."""
    LENS = "lens"
    """Principal point or distortion contradict the images."""
    LINE_TIME = "line_time"
    """The camera file does not say whether the shutter rolls, and how fast: poses are less certain for that."""
    MOUNTING = "mounting"
    """The camera does not sit as its file says, or the vehicle's attitude is off."""
    ATTITUDE_CONTRADICTS = "attitude_contradicts"
    """The images contradict the vehicle's roll and pitch, which are left out."""
    ATTITUDE_MISSING = "attitude_missing"
    """No attitude of the vehicle is near enough to the images."""


class AttitudeLoss(StrEnum):
    """Reason for which the vehicle's attitude was not used."""

    NOT_A_NUMBER = "not_a_number"
    """A sample's time or angle is not finite; counted in samples, the others in images."""
    OUT_OF_REACH = "out_of_reach"
    """No sample is near enough to the image."""
    CONTRADICTS = "contradicts"
    """The images contradict it."""


class EyeState(ToneEnum):
    """Whether a camera delivers poses, and what is in the way if not. This is the one table of these states."""

    OK = "ok", "works", Tone.OK
    DARK = "dark", "too dark", Tone.BAD
    BLOWN = "blown", "too bright", Tone.BAD
    FROZEN = "frozen", "images are frozen", Tone.BAD
    WRONG_SIZE = "wrong_size", "images have the wrong size", Tone.BAD
    WRONG_KIND = "wrong_kind", "images have the wrong kind", Tone.BAD
    UNCALIBRATED = "uncalibrated", "not calibrated", Tone.BAD
    TARGET_MISMATCH = "target_mismatch", "its target contradicts the file", Tone.BAD
    FAILING = "failing", "the detector fails", Tone.BAD
    """The detector fails on every image."""
    STALLED = "stalled", "the detector is stuck", Tone.BAD
    """The detector has not come back from an image."""
    DEAD = "dead", "the detector has ended", Tone.BAD
    """The thread that looks has ended."""
    OPENING = "opening", "opening", Tone.WARN
    SILENT = "silent", "no image arrives", Tone.BAD
    MISSING = "missing", "no report arrives", Tone.BAD
    """A source of poses sends none."""
    REFUSED = "refused", "its reports are refused", Tone.BAD
    CONTRADICTED = "contradicted", "the boards contradict it", Tone.BAD
    """A source of poses shows another motion than the boards, or jumped."""
    DISPUTED = "disputed", "another source contradicts it", Tone.BAD
    """Neither of two sources of poses is used until the boards have shown which is wrong."""
    GONE = "gone", "unplugged", Tone.BAD
    ENDED = "ended", "its images have ended", Tone.WARN


class Exposure(Telemetry):
    """Exposure commanded to a camera, and the brightness of its images."""

    exposure_ms: float
    """Shutter time [ms]."""
    gain: float
    """Over the least gain."""
    black: float | None
    """Of black cells of the target, or of the darkest of the image [grey, in light]; none before the first look."""
    white: float | None
    """Of white cells, or of the brightest of the image [grey, in light]."""
    noise: float | None
    """Deviation of neighbouring pixels [grey, in light]."""


class VisionStats(Stamped):
    """Quality of a camera and its detector: `vision/<camera>/stats`, once a second and on change."""

    camera: str
    """Name of the camera."""
    state: EyeState
    """`ok`, or the first fault; docs/vision.md."""
    reason: str
    """One sentence with what to do; empty when ready."""
    alarms: dict[Alarm, str]
    """Further faults of the images, each with a remedy."""
    source: str
    """Where images come from."""
    width: int
    """[px]; 0 before the first image."""
    height: int
    """[px]."""
    fps: float
    """Images a second from the camera [Hz]."""
    processed: int
    """Images processed."""
    dropped: int
    """Images replaced by a newer one before they were processed."""
    lost: int
    """Images lost on the way, as counted by the source."""
    damaged: int
    """Damaged or unreadable images."""
    reopened: int
    """How often the camera had to be opened again."""
    faults: int
    """Images that made the detector fail."""
    restarts: int
    """Restarts of the vision thread."""
    posed: float
    """Share of the images of the last seconds that gave a pose, 0 to 1."""
    refused: dict[str, int]
    """Refused poses by reason, since the start; docs/vision.md lists the reasons."""
    attitude_lost: dict[AttitudeLoss, int] = Field(default_factory=dict)
    """How often the vehicle's attitude was not used, by reason, since the start."""
    detect_p50_ms: float
    """Time the detector takes an image, median of the last seconds [ms]."""
    detect_p99_ms: float
    """99th percentile [ms]."""
    latency_p50_ms: float
    """From exposure to result, median [ms]."""
    latency_p99_ms: float
    """99th percentile [ms]."""
    settings_refused: tuple[str, ...]
    """Settings that the camera's driver refused."""
    selfcal: tuple[SelfCalibration, ...] = ()
    """Self-calibration against camera file and target files, one for each target seen."""
    exposure: Exposure | None = None
    """Exposure and gain that we choose (`exposure_ms = "target"`); none where the camera or its driver does."""
    trusted_for: tuple[str, ...] | None = None
    """Of a source of poses (`[[positions]]`), what may be flown by it: `takeoff`, `flight`, `landing`. None: a camera.
    A source has reports where a camera has images."""


class TagShape(Telemetry):
    """One printed tag of a target."""

    family: str
    """For example `tag36h11`."""
    id: int
    """Its code."""
    corners: tuple[Vector3, Vector3, Vector3, Vector3]
    """Top-left, top-right, bottom-right, bottom-left of everything black, in the target's frame [m]."""
    cells: tuple[str, ...]
    """Rows of the print from the top, `#` for a black cell and `.` for a white one."""


class TargetShape(Telemetry):
    """A target, as its file describes it."""

    name: str
    """Name of the target."""
    moving: bool
    """Whether it moves in the world."""
    tags: tuple[TagShape, ...]
    """Largest first: a later tag lies on top of an earlier one."""


class LensShape(Telemetry):
    """Projection of a calibrated camera: `[intrinsics]` of a camera file."""

    width: int
    """Of the images [px]."""
    height: int
    """[px]."""
    fx: float
    """Focal length along x [px]."""
    fy: float
    """Focal length along y [px]."""
    cx: float
    """Principal point, x [px; centres at integers]."""
    cy: float
    """Principal point, y [px]."""
    model: str
    """`pinhole` or `fisheye`."""
    distortion: tuple[float, ...]
    """In OpenCV's order: k1, k2, p1, p2, k3 of a pinhole, k1 to k4 of a fisheye."""


class CameraSetup(Stamped):
    """Properties and targets of a camera, from its files: `vision/<camera>/setup`."""

    camera: str
    """Name of the camera."""
    lens: LensShape | None
    """How it projects; null where it is not calibrated."""
    position_flu: Vector3 | None
    """Its centre in the body frame [m]; null if the mounting is unknown."""
    quaternion_flu_from_cam: Quaternion | None
    """Its rotation in the body frame (w, x, y, z); null as above."""
    targets: tuple[TargetShape, ...]
    """Names of its targets."""


class Transform(Stamped):
    """One edge of the tree of frames: `tf`."""

    parent: str
    """Frame the child is expressed in: `body`, `camera/<name>`, a target's frame."""
    child: str
    """Frame that is described."""
    translation: Vector3
    """Origin of the child in the parent [m]."""
    quaternion: Quaternion
    """Rotation parent from child (w, x, y, z)."""
    static: bool
    """It never changes: a mount from the configuration."""
