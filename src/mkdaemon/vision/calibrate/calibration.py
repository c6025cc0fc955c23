"""Content of a camera file, with uncertainties: lens and tone curve by views of a board, line time by a lamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError
from mkdaemon.vision.arrays import Array, Grey
from mkdaemon.vision.calibrate.board import BoardPoints
from mkdaemon.vision.camera.calibration_file import Intrinsics
from mkdaemon.vision.pose.pose import damped

Figures = npt.NDArray[np.integer[Any] | np.floating[Any]]
"""As OpenCV types them."""

PINHOLE: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
FISHEYE: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
"""Unknowns, in the order of the deviations and derivatives that OpenCV gives."""
FLAGS: Final = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW
STEPS: Final = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
MAX_RMS_PX = 0.3
MAX_FOCAL_SD_PERCENT = 0.3
MAX_CENTRE_SD_PX = 1.0
"""Limits of a usable calibration: focal +0.3 % alone is 0.6 cm at 2 m. Source: docs/lab/accuracy.md."""
MIN_VIEWS = 6
MIN_TILT_DEG = 20.0
"""Views from the front alone gave a focal length twice too long and claimed to know it to 0.01 %."""
OUTLIER_FACTOR = 3.0
"""A view whose error is this many times the median is left out: it was moving or half hidden."""
K3_GAIN = 0.98
"""A third radial coefficient is kept only when it lowers the error by two percent: unneeded, it bends the corners."""
GAMMAS: Final = (0.5, 4.0)
"""Curves there are."""
LEAST_EDGES: Final = 60
STEP: Final = 0.01
KNOWN: Final = 0.1
"""Deviation up to which a curve is stored."""
NONE: Final = 0.1
"""A curve nearer to 1 is none: the method itself is off by 6 %."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """Result of a calibration with uncertainties.

    Attributes:
        rms_px: reprojection error over all points [px].
        sd: standard deviation of each intrinsic by its name, in its unit.
        used: indices of the views used.
        tilt_deg: largest angle between two views of the board [deg].
        tone: how its tone curve was found, in words.
    """

    intrinsics: Intrinsics
    rms_px: float
    sd: dict[str, float]
    used: tuple[int, ...]
    tilt_deg: float
    tone: str

    @property
    def focal_sd_percent(self) -> float:
        """Standard deviation of the worse focal length [%]."""
        k = self.intrinsics
        return 100.0 * max(self.sd["fx"] / k.fx, self.sd["fy"] / k.fy)

    @property
    def centre_sd_px(self) -> float:
        """Standard deviation of the worse principal point coordinate [px]."""
        return max(self.sd["cx"], self.sd["cy"])

    def faults(self) -> list[str]:
        """Reasons not to use this result; empty if it is good."""
        found = []
        if not self.rms_px < MAX_RMS_PX:
            found.append(
                f"rms {self.rms_px:.2f} px, must be below {MAX_RMS_PX}: hold still, focus, and print the board flat"
            )
        if not self.focal_sd_percent < MAX_FOCAL_SD_PERCENT:
            known = f"known to {self.focal_sd_percent:.2f} %, must be below {MAX_FOCAL_SD_PERCENT}"
            found.append(f"focal length {known}: add tilted and near views")
        if not self.centre_sd_px < MAX_CENTRE_SD_PX:
            known = f"known to {self.centre_sd_px:.1f} px, must be below {MAX_CENTRE_SD_PX:g}"
            found.append(f"image centre {known}: add views in the corners and turned board")
        if not self.tilt_deg > MIN_TILT_DEG:
            found.append(
                f"all views within {self.tilt_deg:.0f} deg of each other: tilt the board by 30 deg to every side,"
                " views from the front alone do not determine the focal length"
            )
        return found


def calibrate(views: Sequence[BoardPoints], *, is_fisheye: bool = False) -> CalibrationResult:
    """Estimate the intrinsics of a camera from views of one size, in different places and tilts.

    Raises:
        VisionError: too few views, or views that determine nothing.

    Sources: Zhang, PAMI 22(11), 2000; Kannala and Brandt, PAMI 28(8), 2006; both as in OpenCV.
    """
    if len(views) < MIN_VIEWS:
        msg = f"{len(views)} views of the board, at least {MIN_VIEWS} are needed"
        raise VisionError(msg)
    used = list(range(len(views)))
    lens = _solve(views, is_fisheye=is_fisheye)
    for _ in range(2):
        limit = max(OUTLIER_FACTOR * float(np.median(lens.errors)), MAX_RMS_PX)
        kept = [k for k, error in zip(used, lens.errors, strict=True) if error <= limit]
        if len(kept) == len(used) or len(kept) < MIN_VIEWS:
            break
        used = kept
        lens = _solve([views[k] for k in used], is_fisheye=is_fisheye)
    if not np.isfinite([lens.values, lens.sd]).all() or min(lens.values[:2]) <= 0:
        raise VisionError("the views are too similar: show the board tilted, near, and at the rim of the image")
    names = FISHEYE if is_fisheye else PINHOLE
    # seven digits are far below any uncertainty, and short enough to read
    values = {name: float(f"{value:.7g}") for name, value in zip(names, lens.values.tolist(), strict=True)}
    sd = dict(zip(names, lens.sd.tolist(), strict=True))
    gamma, tone = tone_curve(np.concatenate([view.levels for view in views]))
    width, height = views[0].size
    shape = {"width": width, "height": height, "model": "fisheye" if is_fisheye else "pinhole", "gamma": gamma}
    normals = np.array([views[k].normal for k in used])
    tilt_deg = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0).min())))
    return CalibrationResult(Intrinsics.model_validate(shape | values), lens.rms, sd, tuple(used), tilt_deg, tone)


@dataclass(frozen=True, slots=True, eq=False)
class _Lens:
    """What views say about a lens: its unknowns, their deviations `(k,)`, errors of each view `(n,)` and rms [px]."""

    values: Figures
    sd: Figures
    errors: Figures
    rms: float


def _solve(views: Sequence[BoardPoints], *, is_fisheye: bool) -> _Lens:
    board = [view.board[:, None].astype(np.float32) for view in views]
    image = [view.image[:, None].astype(np.float32) for view in views]
    try:
        return (_solve_fisheye if is_fisheye else _solve_pinhole)(board, image, views[0].size)
    except cv2.error as error:
        msg = f"the views determine no {'fisheye' if is_fisheye else 'pinhole'}: {error.err}"
        raise VisionError(msg) from None


def _values(matrix: Figures, bend: Figures) -> Figures:
    """Unknowns in the order of `PINHOLE` and `FISHEYE`."""
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *bend.ravel()], dtype=np.float64)


def _solve_pinhole(board: Sequence[Figures], image: Sequence[Figures], size: tuple[int, int]) -> _Lens:
    """Two radial coefficients, or three where the third earns its place."""
    short, full = (
        cv2.calibrateCameraExtended(board, image, size, np.eye(3), np.zeros(5), flags=flags)
        for flags in (cv2.CALIB_FIX_K3, 0)
    )
    rms, matrix, bend, _, _, sd, _, errors = full if full[0] < K3_GAIN * short[0] else short
    return _Lens(_values(matrix, bend), sd.ravel()[: len(PINHOLE)], errors.ravel(), rms)


def _solve_fisheye(board: Sequence[Figures], image: Sequence[Figures], size: tuple[int, int]) -> _Lens:
    """With the deviations that OpenCV does not give."""
    rms, matrix, bend, turns, places = cv2.fisheye.calibrate(
        board, image, size, np.eye(3), np.zeros(4), flags=FLAGS, criteria=STEPS
    )
    unknowns = len(FISHEYE)
    information, errors = np.zeros((unknowns, unknowns)), []
    for points, pixels, turn, place in zip(board, image, turns, places, strict=True):
        seen, jacobian = cv2.fisheye.projectPoints(points, turn, place, matrix, bend)
        errors.append(float(np.sqrt(2.0 * np.mean((pixels - seen) ** 2))))
        # what is left of a view once its own pose is free
        by = np.asarray(jacobian, np.float64)[:, : unknowns + 6]
        information += np.linalg.inv(np.linalg.inv(damped(by.T @ by))[:unknowns, :unknowns])
    count = sum(len(points) for points in board)
    covariance = rms**2 * count / max(2 * count - unknowns - 6 * len(board), 1) * np.linalg.inv(damped(information))
    return _Lens(_values(matrix, bend), np.sqrt(np.diag(covariance)), np.array(errors), rms)


def tone_curve(levels: Array) -> tuple[float, str]:
    """The tone curve of a camera, light is grey to that power, 1 where none is known; and how it was found, in words.

    By black b, middle and white w `(n, 3)` of straight edges, where blur mixes as much black as white, in light: the
    grey value there is ((b^g + w^g) / 2)^(1/g) for a curve of the power g.
    """
    if len(levels) < LEAST_EDGES:
        return 1.0, f"not known: {LEAST_EDGES} edges with black and white in range are needed, {len(levels)} were seen"
    black, middle, white = levels.T
    gammas = np.arange(GAMMAS[0], GAMMAS[1] + STEP, STEP)[:, None]
    off = middle - ((black**gammas + white**gammas) / 2) ** (1 / gammas)
    best = int(np.abs(off).sum(axis=1).argmin())
    if best in (0, len(gammas) - 1):
        return 1.0, "not known: the edges of the board show no tone curve: sharpen the focus, even the light"
    slope = float(np.linalg.norm(off[best + 1] - off[best - 1])) / (2 * STEP)
    gamma, sd = round(float(gammas[best, 0]), 4), float(np.sqrt(np.mean(off[best] ** 2))) / max(slope, 1e-9)
    words = f"{gamma:.2f} +- {sd:.2f} from {len(levels)} edges"
    if sd > KNOWN:
        return 1.0, f"not known: {words}"
    return (1.0, f"{words}: as good as none") if abs(gamma - 1.0) < NONE else (gamma, words)


LEAST_IMAGES: Final = 8
LEAST_BANDS: Final = 1.5
"""Periods of the flicker in an image from which their distance can be computed."""
MOST_PER_ROW: Final = 0.1
"""Periods a row at most: a readout of one period in ten rows is none."""
FINER: Final = 20
"""Frequencies tried between those of a Fourier transform."""
CLEAR: Final = 6.0
"""Power of the bands over the median power from which they are bands."""


def line_time_of(images: Sequence[Grey], flicker_hz: float) -> tuple[float, float]:
    """Line time of a rolling shutter, and its deviation [s].

    Rows exposed one after the other see the light rise and fall: bands across the image, whose distance is a period of
    the flicker over the line time. What stands still goes out in the mean of the images.

    Args:
        images: of one scene at rest under the lamp `(h, w)`, at least eight.
        flicker_hz: twice the mains frequency: 100 or 120 Hz.

    Raises:
        VisionError: too few images, or no bands.
    """
    if len(images) < LEAST_IMAGES:
        msg = f"{len(images)} images, at least {LEAST_IMAGES} are needed"
        raise VisionError(msg)
    rows = np.log(np.array([image.mean(axis=1) for image in images]) + 1.0)
    bands = rows - rows.mean(axis=0)
    bands -= bands.mean(axis=1, keepdims=True)
    height = bands.shape[1]
    # Frequencies in periods a row, FINER times as close as those of the image: the window is padded with zeros.
    tried = np.fft.rfftfreq(FINER * height)
    is_band = (tried * height >= LEAST_BANDS) & (tried < MOST_PER_ROW)
    tried = tried[is_band]
    each = np.abs(np.fft.rfft(bands * np.hanning(height), FINER * height)[:, is_band]) ** 2
    power = each.sum(axis=0)
    best = int(power.argmax())
    if best in (0, len(tried) - 1) or power[best] < CLEAR * float(np.median(power)):
        msg = "no bands of a flickering lamp in the images"
        raise VisionError(f"{msg}: show a plain wall under a lamp on mains, exposure below 5 ms, nothing moving")
    parts = np.array_split(each, min(len(images) // 2, LEAST_IMAGES))
    found = [tried[part.sum(axis=0).argmax()] for part in parts]
    sd = float(np.std(found)) / np.sqrt(len(found)) + 0.5 / (FINER * height)
    # Periods a row over periods a second are seconds a row.
    return float(tried[best]) / flicker_hz, sd / flicker_hz
