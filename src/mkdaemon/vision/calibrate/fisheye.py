"""The fisheye model from views of a board, with the deviations that OpenCV does not give."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from mkdaemon.errors import VisionError
from mkdaemon.vision.calibrate.board import BoardPoints

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
