"""A vehicle that moves and turns over a tag by a known law, as a camera and a reference see it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from mkdaemon.view.report.alignment import Array, PoseTrack

POSE_NOISE = 0.002
TURN_NOISE = math.radians(0.15)
"""Of the camera, each axis [m] [rad]; the reference has a quarter of it."""


def truth(at: float) -> tuple[Array, Array]:
    """Position (3,) [m] and target from FLU (3, 3) at a time [s]: 1 to 3 m high, sideways by 0.6 m, turned, tilted."""
    wave = [math.sin(2.0 * math.pi * rate * at + phase) for rate, phase in WAVES]
    position = np.array([0.6 * wave[0], 0.5 * wave[1], 2.0 + wave[2]])
    return position, rotation_from_euler(0.12 * wave[3], 0.12 * wave[4], 1.5 * wave[5])


WAVES = ((0.11, 0.0), (0.13, 1.0), (0.05, 2.0), (0.3, 0.0), (0.23, 1.0), (0.07, 0.5))


@dataclass(frozen=True)
class Wrong:
    """What is wrong with the camera.

    Attributes:
        scale: of its distances.
        place: where it believes the vehicle to be, in the vehicle (3,) [m; FLU].
        turn: how it believes it to be turned, roll, pitch, yaw [rad].
        frame: place of its target in the frame of the reference (3,) [m].
        heading: of its target there [rad].
        lag: of its stamps [s].
    """

    scale: float = 1.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0
    lag: float = 0.0


RIGHT = Wrong()
PARTS = ("times", "positions", "rotations", "latencies")
"""Of a track, one for each pose."""


def tracks(wrong: Wrong = RIGHT, seconds: float = 40.0, seed: int = 1) -> tuple[PoseTrack, PoseTrack]:
    """Camera of 20 Hz and reference of 33 Hz."""
    rng = np.random.default_rng(seed)
    reference = _track(np.arange(0.0, seconds, 0.03), 0.25, rng)
    seen = _track(np.arange(0.01, seconds, 0.05), 1.0, rng)
    frame = rotation_from_euler(0.0, 0.0, wrong.heading)
    positions = (seen.positions + seen.rotations @ np.array(wrong.place)) @ frame.T + wrong.frame
    rotations = frame @ seen.rotations @ rotation_from_euler(*wrong.turn)
    camera = PoseTrack(seen.times + wrong.lag, wrong.scale * positions, rotations, seen.latencies)
    return camera, reference


def _track(times: Array, noise: float, rng: np.random.Generator) -> PoseTrack:
    poses = [truth(at) for at in times]
    shaken = [turn @ rotation_from_euler(*(noise * TURN_NOISE * rng.standard_normal(3))) for _, turn in poses]
    positions = np.array([place for place, _ in poses]) + noise * POSE_NOISE * rng.standard_normal((len(times), 3))
    return PoseTrack(times, positions, np.array(shaken), np.full(len(times), 0.08 * noise))


def without(track: PoseTrack, *pauses: tuple[float, float]) -> PoseTrack:
    """A track with pauses [s]."""
    kept = np.ones(len(track.times), dtype=bool)
    for begin, end in pauses:
        kept &= (track.times < begin) | (track.times > end)
    return only(track, kept)


def only(track: PoseTrack, kept: Array) -> PoseTrack:
    """Those poses of a track that are kept."""
    return replace(track, **{name: getattr(track, name)[kept] for name in PARTS})


def pose_fields(name: str, number: int, position: Array, rotation: Array, target: str = "pad") -> dict[str, Any]:
    """What a comparison reads of a `VisionPose`."""
    return {
        "camera": name,
        "sequence": number,
        "target": target,
        "latency": 0.05,
        "position_target": position.tolist(),
        "quaternion_target_from_flu": list(quaternion_from_rotation(rotation)),
    }
