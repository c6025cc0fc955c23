"""Poses of a camera against those of a reference: errors, detection, drop-outs, by distance and viewing angle. Pure."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from mkdaemon.view.report.alignment import (
    LEAST_PAIRS,
    QUANTITIES,
    Array,
    Mask,
    Pairs,
    PoseTrack,
    Quantity,
    TagView,
    aligned,
    nearest_rotation,
    rotation_vectors,
)

IN_BIN: Final = 10
"""Errors of a bin with fewer pairs are left out."""
DISTANCES: Final = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, math.inf)
ANGLES: Final = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0)
LENGTHS: Final = (0.0, 0.2, 0.5, 1.0, 2.0, math.inf)
"""Edges of the classes: distance [m], angle between line of sight and the tag's normal [deg], drop-outs [s]."""
STILL_M: Final = 0.1
STILL_DEG: Final = 5.0
"""A reference that moves and turns by less (standard deviation) stands still: ten times the error of good tags."""
OUT_OF_SIGHT, NO_TAG, NO_IMAGE, OTHER_TAGS = "out of sight", "no tag found", "no image", "only other tags"


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Every image of the camera, in order.

    Attributes:
        times: (n,) [s].
        outcomes: empty for a pose, else why there is none.
        weights: (n,), below 1 where the image may have been dropped before it was processed.
    """

    times: Array
    outcomes: Sequence[str]
    weights: Array


class Spread(NamedTuple):
    """Sizes of an error: median, 90th percentile, worst."""

    median: float
    p90: float
    worst: float

    @classmethod
    def of(cls, errors: Array) -> Spread | None:
        """Of errors (n,); None for fewer than `IN_BIN`."""
        if len(errors) < IN_BIN:
            return None
        sizes = np.abs(errors)
        return cls(float(np.median(sizes)), float(np.quantile(sizes, 0.9)), float(sizes.max()))


@dataclass(frozen=True, slots=True, eq=False)
class PairErrors:
    """Camera less reference, one row a pair.

    Attributes:
        times: (n,) [s].
        distances: from the camera to the tag, by the reference (n,) [m].
        angles: between line of sight and normal, by the reference (n,) [deg].
        scales: measured over true distance (n,).
        along: the line of sight, too far is positive (n,) [m].
        across: the line of sight (n,) [m].
        rpy: roll, pitch, yaw against the reference (n, 3) [deg; FLU].
        turns: angle of the whole rotation (n,) [deg].
    """

    times: Array
    distances: Array
    angles: Array
    scales: Array
    along: Array
    across: Array
    rpy: Array
    turns: Array


class Bin(NamedTuple):
    """Figures of a class of distances [m] or angles [deg].

    Attributes:
        low: its edge.
        high: its edge.
        images: with the target in view.
        posed: of those, with a pose.
        pairs: compared.
        scale: median; None for too few pairs.
        along: error along the line of sight [m].
        across: error across it [m].
        turn: angle of the rotation [deg].
    """

    low: float
    high: float
    images: float
    posed: int
    pairs: int
    scale: float | None
    along: Spread | None
    across: Spread | None
    turn: Spread | None


class Offset(NamedTuple):
    """A fitted constant [SI] with its standard deviation; see `QUANTITIES`."""

    quantity: Quantity
    value: float
    sd: float

    @property
    def is_known(self) -> bool:
        """Whether the recording determines it."""
        return self.sd <= self.quantity.known

    @property
    def is_found(self) -> bool:
        """Whether it is certain, and large enough to matter."""
        return self.is_known and abs(self.value) > max(3.0 * self.sd, self.quantity.finds)


class DropOut(NamedTuple):
    """A pause in the camera's poses: from, to [s], and why."""

    begin: float
    end: float
    reason: str

    @property
    def length(self) -> float:
        """[s]."""
        return self.end - self.begin


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """A camera against a reference.

    Attributes:
        offsets: one for each of `QUANTITIES`.
        raw: errors as recorded.
        errors: without the constant offsets and the lag; the scale stays in, an error of the camera.
        distances: figures by distance.
        angles: by viewing angle.
        drop_outs: of the camera, while the reference was there or not.
        moved: how far the reference moved (standard deviation) [m].
        turned: and how far it turned [deg].
    """

    offsets: tuple[Offset, ...]
    raw: PairErrors
    errors: PairErrors
    distances: tuple[Bin, ...]
    angles: tuple[Bin, ...]
    drop_outs: tuple[DropOut, ...]
    moved: float
    turned: float

    @property
    def is_still(self) -> bool:
        """Whether the reference stands still: it determines neither scale, lag nor mounting."""
        return self.moved < STILL_M and self.turned < STILL_DEG


class NoAnswer(NamedTuple):
    """Why the recording has no answer, and what to do: a sentence."""

    reason: str


def compare(camera: PoseTrack, reference: PoseTrack, sight: TagView, images: Images) -> Baseline | NoAnswer:
    """Compare a camera with a reference.

    Args:
        camera: its poses.
        reference: the base line.
        sight: what the camera sees.
        images: all of its images, for the detection.
    """
    for name, track in (("camera", camera), ("reference", reference)):
        if len(track.times) < LEAST_PAIRS:
            return NoAnswer(
                f"The {name} has {len(track.times)} poses, and {LEAST_PAIRS} are needed: record a longer flight with "
                "the target in view of the camera and the body in view of the reference."
            )
    known, positions, rotations = reference.at(camera.times)
    if known.sum() < LEAST_PAIRS:
        if camera.times[0] > reference.times[-1] or camera.times[-1] < reference.times[0]:
            return NoAnswer("Camera and reference do not overlap in time: record both at once, on one clock.")
        return NoAnswer(
            f"Only {known.sum()} poses of the camera fall between two of the reference, and {LEAST_PAIRS} are needed: "
            "record a longer flight in view of both."
        )
    moved = math.sqrt(float(positions[known].var(axis=0).sum()))
    mean = nearest_rotation(rotations[known].mean(axis=0))
    turned = math.degrees(float(np.sqrt((rotation_vectors(mean.T @ rotations[known]) ** 2).sum(axis=1).mean())))
    pairs = Pairs(camera, reference, sight)
    values, sds = pairs.fitted()
    if moved < STILL_M and turned < STILL_DEG:
        sds[13] = QUANTITIES[13].prior  # the noise of a reference at rest looks like motion to a fit
    raw = _errors(camera, sight, known, positions, rotations)
    errors = _errors(camera, sight, *aligned(reference, camera.times, values))
    shown, seen_from, turned_to = aligned(reference, images.times, values)
    away, _, cosine, inside = sight.look(seen_from, turned_to)
    is_posed = np.array([not outcome for outcome in images.outcomes], dtype=bool)
    counted = shown & (inside | is_posed)
    found = np.linalg.norm(away, axis=1), np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    bins = [
        tuple(_bins(edges, images, is_posed, counted, of_images, errors, of_pairs))
        for edges, of_images, of_pairs in ((DISTANCES, found[0], errors.distances), (ANGLES, found[1], errors.angles))
    ]
    return Baseline(
        offsets=tuple(Offset(*row) for row in zip(QUANTITIES, values.tolist(), sds.tolist(), strict=True)),
        raw=raw,
        errors=errors,
        distances=bins[0],
        angles=bins[1],
        drop_outs=drop_outs(camera, images, shown & ~inside),
        moved=moved,
        turned=turned,
    )


def _errors(camera: PoseTrack, sight: TagView, known: Mask, positions: Array, rotations: Array) -> PairErrors:
    """Errors of the camera against poses of the reference at its times."""
    positions, rotations = positions[known], rotations[known]
    mine, turns = camera.positions[known], camera.rotations[known]
    away, tags, cosine, _ = sight.look(positions, rotations)
    distances = np.maximum(np.linalg.norm(away, axis=1), 1e-6)
    off, line = mine - positions, away / distances[:, None]
    along = (off * line).sum(axis=1)
    deviation = rotations.transpose(0, 2, 1) @ turns
    pitch = -np.arcsin(np.clip(deviation[:, 2, 0], -1.0, 1.0))
    roll, yaw = (np.arctan2(deviation[:, 2, 1], deviation[:, 2, 2]), np.arctan2(deviation[:, 1, 0], deviation[:, 0, 0]))
    return PairErrors(
        times=camera.times[known],
        distances=distances,
        angles=np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))),
        scales=np.linalg.norm(mine + turns @ sight.arm - tags, axis=1) / distances,
        along=along,
        across=np.linalg.norm(off - along[:, None] * line, axis=1),
        rpy=np.degrees(np.column_stack([roll, pitch, yaw])),
        turns=np.degrees(np.linalg.norm(rotation_vectors(deviation), axis=1)),
    )


def _bins(
    edges: Sequence[float],
    images: Images,
    posed: Mask,
    counted: Mask,
    of_images: Array,
    errors: PairErrors,
    of_pairs: Array,
) -> list[Bin]:
    """Figures by class of what images (n,) and pairs (m,) have; classes without any are left out."""
    found = []
    for low, high in pairwise(edges):
        seen = counted & (of_images >= low) & (of_images < high)
        paired = (of_pairs >= low) & (of_pairs < high)
        number = int(paired.sum())
        if number or seen.any():
            scale = float(np.median(errors.scales[paired])) if number >= IN_BIN else None
            spreads = (Spread.of(one[paired]) for one in (errors.along, errors.across, errors.turns))
            found.append(
                Bin(low, high, float(images.weights[seen].sum()), int((seen & posed).sum()), number, scale, *spreads)
            )
    return found


def drop_outs(track: PoseTrack, images: Images, hidden: Mask) -> tuple[DropOut, ...]:
    """Pauses of a track with the commonest outcome of their images; `hidden` are images (n,) without the target."""
    found = []
    for begin, end in track.pauses():
        first, last = np.searchsorted(images.times, begin, "right"), np.searchsorted(images.times, end, "left")
        reasons = Counter(
            OUT_OF_SIGHT if hidden[k] else images.outcomes[k] for k in range(first, last) if images.outcomes[k]
        )
        found.append(DropOut(begin, end, reasons.most_common(1)[0][0] if reasons else NO_IMAGE))
    return tuple(found)
