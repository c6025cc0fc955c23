"""The prints of a target: tags beside each other are one each, a tag inside a larger one belongs to that."""

from __future__ import annotations

from math import acos
from typing import Final

import numpy as np

from mkdaemon.vision.arrays import Array
from mkdaemon.vision.pose.bend import Sheet
from mkdaemon.vision.pose.pose import Pose
from mkdaemon.vision.pose.printmodel import PrintModel
from mkdaemon.vision.pose.projection import NEAR_M, Projection
from mkdaemon.vision.tags.tagmap import Tag, Target, covered

MOST: Final = 8
"""Prints that a fit to grey values takes; eight took five times as long as one, and 16 halve the deviation no more than
by 0.7."""

SHOWN: Final = 0.3
"""Share of a print's width and of its height that lies in the image, where it is fitted."""


def roots(target: Target) -> tuple[Tag, ...]:
    """Tags that lie on no larger one's paper, largest first."""
    tags = target.tags
    return tuple(tag for k, tag in enumerate(tags) if not any(covered(tag.position[None], other) for other in tags[:k]))


def sheet_of(target: Target) -> Sheet | None:
    """The sheet of a target that is one print; none where it cannot bend, or has several prints.

    Prints beside each other fix the pose by their places, which nobody tells how a sheet would bend.
    """
    found = roots(target)
    return Sheet(found[0], target.bend) if len(found) == 1 and target.bend > 0.0 else None


class Prints:
    """The prints of one target, and which of them an image shows.

    Attributes:
        roots: the largest tag of each, largest first.
        all: the prints, in the same order.
        sheet: of a target's only print; none where it does not bend.
    """

    def __init__(self, target: Target, projection: Projection) -> None:
        self._projection = projection
        self.roots = roots(target)
        self.sheet = sheet_of(target)
        self.all = tuple(PrintModel(target, tag, projection, self.sheet) for tag in self.roots)

    def seen(self, rotation: Array, position: Array, shape: tuple[int, ...] | None = None) -> tuple[PrintModel, ...]:
        """Prints of which a pose puts enough into the image, the largest there first.

        Args:
            rotation: camera from target `(3, 3)`.
            position: of the target `(3,)` [m; RDF].
            shape: of the image; that of the calibration if none is given.
        """
        intrinsics = self._projection.intrinsics
        height, width = (intrinsics.height, intrinsics.width) if shape is None else shape
        shown = [model for model in self.all if self._is_shown(model, rotation, position, width, height)]
        return tuple(sorted(shown, key=lambda model: model.depth(rotation, position) / model.cell)[:MOST])

    def cell_px(self, pose: Pose) -> float:
        """Side of a cell of the print that is looked at [px]."""
        model = self._looked_at(pose)
        return float(self._projection.focal[0]) * model.cell / max(model.depth(pose.rotation, pose.position), NEAR_M)

    def looked_at(self, pose: Pose) -> tuple[Array, Array, float]:
        """The largest print that is seen, the first where none is: its middle, the way to the camera, its tilt.

        Returns:
            The middle `(3,)` [m; target], the direction from there to the camera `(3,)`, and the angle between that and
            the normal [rad].
        """
        model = self._looked_at(pose)
        middle = pose.rotation @ model.origin + pose.position
        toward: Array = -middle / max(float(np.linalg.norm(middle)), NEAR_M)
        normal = pose.rotation @ model.axes[:, 2]
        return model.origin, toward, acos(min(max(float(normal @ toward), -1.0), 1.0))

    def _looked_at(self, pose: Pose) -> PrintModel:
        """The largest print that is seen; the first where none is."""
        if len(self.all) == 1:
            return self.all[0]
        return next(iter(self.seen(pose.rotation, pose.position)), self.all[0])

    def _is_shown(self, model: PrintModel, rotation: Array, position: Array, width: int, height: int) -> bool:
        if model.depth(rotation, position) < NEAR_M:
            return False
        corners = model.corners @ rotation.T + position
        seen, visible = self._projection.project(corners)
        if not bool(visible.all()):
            return False
        shown = np.clip(seen, 0.0, np.array([width - 1, height - 1]))
        return bool((np.ptp(shown, axis=0) >= SHOWN * np.ptp(seen, axis=0)).all())
