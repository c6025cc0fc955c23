"""From views of a board to a camera file with uncertainties; a poor result is refused.

The fisheye model from views of a board, with the deviations that OpenCV does not give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError
from mkdaemon.vision.calibrate.board import BoardPoints, board_normal
from mkdaemon.vision.camera.intrinsics import Intrinsics

Array = npt.NDArray[np.float64]

NAMES: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
"""Unknowns, in the order of the derivatives that OpenCV's `fisheye.projectPoints` gives."""
FLAGS: Final = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW
STEPS: Final = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
RIDGE: Final = 1e-9
"""Share of the diagonal added before a normal matrix is inverted."""


def solve_fisheye(views: Sequence[BoardPoints], width: int, height: int) -> tuple[dict[str, float], Array, Array]:
    """Estimate a fisheye.

    Args:
        views: of the board.
        width: of the images [px].
        height: of the images [px].

    Returns:
        Values by name, deviations `(8,)` in the order of `NAMES`, and the reprojection error of each view [px].

    Raises:
        VisionError: the views determine nothing.

    Source: Kannala and Brandt, PAMI 28(8), 2006, as in OpenCV's `fisheye`.
    """
    board = [np.ascontiguousarray(view.board).reshape(-1, 1, 3) for view in views]
    image = [np.ascontiguousarray(view.image).reshape(-1, 1, 2) for view in views]
    try:
        _, matrix, bend, turns, places = cv2.fisheye.calibrate(
            board, image, (width, height), np.eye(3), np.zeros(4), flags=FLAGS, criteria=STEPS
        )
    except cv2.error as error:
        msg = f"the views determine no fisheye: {error.err}"
        raise VisionError(msg) from None
    values = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *bend.ravel()])
    if not np.isfinite(values).all() or min(values[:2]) <= 0:
        msg = "the views determine no fisheye: show the board tilted, near, and at the rim"
        raise VisionError(msg)
    information = np.zeros((len(NAMES), len(NAMES)))
    squares, errors = 0.0, []
    for points, pixels, turn, place in zip(board, image, turns, places, strict=True):
        seen, jacobian = cv2.fisheye.projectPoints(points, turn, place, matrix, bend)
        residual = (pixels - seen).reshape(-1)
        lens, pose = jacobian[:, : len(NAMES)], jacobian[:, len(NAMES) : len(NAMES) + 6]
        both, own = pose.T @ lens, pose.T @ pose
        # what is left of a view once its own pose is free: the Schur complement
        information += lens.T @ lens - both.T @ np.linalg.solve(own + RIDGE * np.diag(np.diag(own)), both)
        squares += float(residual @ residual)
        errors.append(float(np.sqrt(2.0 * np.mean(residual**2))))
    freedom = max(2 * sum(len(points) for points in board) - len(NAMES) - 6 * len(board), 1)
    covariance = squares / freedom * np.linalg.inv(information + RIDGE * np.diag(np.diag(information)))
    named = dict(zip(NAMES, (float(value) for value in values), strict=True))
    return named, np.sqrt(np.diag(covariance)), np.array(errors)


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


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """What a calibration found and how well it is known.

    Attributes:
        intrinsics: the estimate.
        rms_px: reprojection error over all points [px].
        sd: standard deviation of each intrinsic by its name, in its unit.
        view_rms_px: error of each view that was given [px]; NaN for those left out.
        used: indices of the views used.
        tilt_deg: largest angle between two views of the board [deg].
    """

    intrinsics: Intrinsics
    rms_px: float
    sd: dict[str, float]
    view_rms_px: Array
    used: tuple[int, ...]
    tilt_deg: float

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
        """Why this result should not be used; empty when it is good."""
        found = []
        if not self.rms_px < MAX_RMS_PX:
            found.append(
                f"rms {self.rms_px:.2f} px, must be below {MAX_RMS_PX}: hold still, focus, and print the board flat"
            )
        if not self.focal_sd_percent < MAX_FOCAL_SD_PERCENT:
            found.append(
                f"focal length known to {self.focal_sd_percent:.2f} %, must be below {MAX_FOCAL_SD_PERCENT}:"
                " add tilted and near views"
            )
        if not self.centre_sd_px < MAX_CENTRE_SD_PX:
            found.append(
                f"image centre known to {self.centre_sd_px:.1f} px, must be below {MAX_CENTRE_SD_PX:g}:"
                " add views in the corners and turned board"
            )
        if not self.tilt_deg > MIN_TILT_DEG:
            found.append(
                f"all views within {self.tilt_deg:.0f} deg of each other: tilt the board by 30 deg to every side,"
                " views from the front alone do not determine the focal length"
            )
        return found


def calibrate(views: Sequence[BoardPoints], width: int, height: int, *, is_fisheye: bool = False) -> CalibrationResult:
    """Estimate the intrinsics of a camera.

    Args:
        views: the board in at least six images, in different places and tilts.
        width: of the images [px].
        height: of the images [px].
        is_fisheye: the lens is a fisheye; see `solve_fisheye`.

    Raises:
        VisionError: too few views, or views that determine nothing.

    Source: Zhang, A Flexible New Technique for Camera Calibration, PAMI 22(11), 2000, as in OpenCV.
    """
    used = list(range(len(views)))
    if len(used) < MIN_VIEWS:
        msg = f"{len(used)} views of the board, at least {MIN_VIEWS} are needed"
        raise VisionError(msg)
    solve = _fisheye if is_fisheye else _best
    result = solve(views, used, width, height)
    for _ in range(2):
        errors = result.view_rms_px[used]
        limit = max(OUTLIER_FACTOR * float(np.median(errors)), MAX_RMS_PX)
        kept = [k for k, error in zip(used, errors, strict=True) if error <= limit]
        if len(kept) == len(used) or len(kept) < MIN_VIEWS:
            break
        used = kept
        result = solve(views, used, width, height)
    return result


def _best(views: Sequence[BoardPoints], used: list[int], width: int, height: int) -> CalibrationResult:
    """Two radial coefficients, or three where the third earns its place."""
    short = _solve(views, used, width, height, cv2.CALIB_FIX_K3)
    full = _solve(views, used, width, height, 0)
    return full if full.rms_px < K3_GAIN * short.rms_px else short


def _fisheye(views: Sequence[BoardPoints], used: list[int], width: int, height: int) -> CalibrationResult:
    chosen = [views[k] for k in used]
    values, sd, per_view = solve_fisheye(chosen, width, height)
    errors = np.full(len(views), np.nan)
    errors[used] = per_view
    counts = np.array([len(view.ids) for view in chosen])
    return CalibrationResult(
        Intrinsics.model_validate({"width": width, "height": height, "model": "fisheye", **values}),
        float(np.sqrt((counts * per_view**2).sum() / counts.sum())),
        dict(zip(values, (float(v) for v in sd), strict=True)),
        errors,
        tuple(used),
        _tilt_deg(chosen, width, height),
    )


def _solve(views: Sequence[BoardPoints], used: list[int], width: int, height: int, flags: int) -> CalibrationResult:
    board = [views[k].board.astype(np.float32) for k in used]
    image = [views[k].image.astype(np.float32) for k in used]
    try:
        rms, matrix, distortion, _, _, sd, _, per_view = cv2.calibrateCameraExtended(
            board, image, (width, height), np.eye(3), np.zeros(5), flags=flags
        )
    except cv2.error as error:
        msg = f"the views determine nothing: {error.err}"
        raise VisionError(msg) from None
    d = distortion.ravel()
    values = dict(zip(("k1", "k2", "p1", "p2", "k3"), (float(v) for v in d), strict=False))
    found = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *d])
    if not np.isfinite(found).all() or not np.isfinite(sd).all() or min(found[:2]) <= 0:
        msg = "the views determine nothing: show the board tilted, not only from the front"
        raise VisionError(msg)
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    errors = np.full(len(views), np.nan)
    errors[used] = per_view.ravel()
    intrinsics = Intrinsics(
        width=width,
        height=height,
        fx=float(found[0]),
        fy=float(found[1]),
        cx=float(found[2]),
        cy=float(found[3]),
        **values,
    )
    return CalibrationResult(
        intrinsics,
        float(rms),
        dict(zip(names, (float(v) for v in sd.ravel()), strict=False)),
        errors,
        tuple(used),
        _tilt_deg([views[k] for k in used], width, height),
    )


def _tilt_deg(views: Sequence[BoardPoints], width: int, height: int) -> float:
    """Largest angle between the directions the board faced [deg]."""
    normals = np.array([n for view in views if (n := board_normal(view, width, height)) is not None])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0).min()))) if len(normals) else 0.0


def rounded(intrinsics: Intrinsics) -> Intrinsics:
    """Figures as they are stored: far below their uncertainty, short enough to read."""
    changes = {name: round(getattr(intrinsics, name), 4) for name in ("fx", "fy", "cx", "cy", "gamma")}
    changes |= {name: round(getattr(intrinsics, name), 7) for name in ("k1", "k2", "p1", "p2", "k3", "k4")}
    return intrinsics.model_copy(update=changes)
