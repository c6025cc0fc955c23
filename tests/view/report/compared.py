"""A vehicle that moves and turns over a tag by a known law, as a camera and a reference see and record it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from mkdaemon.view.report.alignment import Array, PoseTrack
from tests.view.report.known import Tape

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


HIDDEN: Final = (12.0, 13.5)
"""The camera refuses meanwhile [s]."""
NOTHING: Final = (20.0, 20.6)
"""Meanwhile it finds no tag, and publishes nothing [s]."""
SETUP: Final = {
    "camera": "down",
    "lens": {"width": 640, "height": 480, "fx": 300.0, "fy": 300.0, "cx": 319.5, "cy": 239.5, "model": "fisheye"},
    "position_flu": [0.0, 0.0, 0.0],
    "quaternion_flu_from_cam": [0.0, 0.7071067811865476, -0.7071067811865476, 0.0],
    "targets": [
        {"name": "pad", "tags": [{"corners": [[-0.1, 0.1, 0], [0.1, 0.1, 0], [0.1, -0.1, 0], [-0.1, -0.1, 0]]}]}
    ],
}


def add_poses(tape: Tape, name: str, track: PoseTrack, target: str = "pad", late: float = 0.0) -> None:
    """Add poses of a camera or a source, later by some time [s]; the camera `down` has drop-outs."""
    for number, (at, place, turn) in enumerate(zip(track.times, track.positions, track.rotations, strict=True)):
        if name == "down" and HIDDEN[0] < at < HIDDEN[1]:
            tape.add(at, "vision/down/refused", {"sequence": number, "target": target, "refusal": "ambiguous"})
            tape.add(at, "vision/down/tags", {"sequence": number, "tags": []})
        elif name != "down" or not NOTHING[0] < at < NOTHING[1]:
            tape.add(at + late, f"vision/{name}/pose", pose_fields(name, number, place, turn, target))


def recorded(path: Path, wrong: Wrong = RIGHT, *, as_reports: bool = False) -> Path:
    """A camera and motion capture for 30 s; as poses of the daemon, or as reports that no daemon used."""
    tape = Tape()
    camera, reference = tracks(wrong, seconds=30.0)
    add_poses(tape, "down", camera)
    if as_reports:
        rows = zip(reference.times, reference.positions, reference.rotations, strict=True)
        for number, (at, place, turn) in enumerate(rows):
            report = {"sequence": number, "epoch": 1, "age": 0.05, "position": place.tolist()}
            tape.add(at + 0.05, "positions/mocap/report", report | {"quaternion": list(quaternion_from_rotation(turn))})
    else:
        add_poses(tape, "mocap", reference)
    for at in (0.0, 29.0):
        tape.add(at, "vision/down/stats", {"dropped": 4 if at else 1, "lost": 0})
    tape.add(0.5, "vision/down/setup", SETUP)
    return tape.write(path)


def apart(path: Path) -> Path:
    """The reference begins when the camera has ended."""
    tape = Tape()
    camera, reference = tracks(seconds=10.0)
    add_poses(tape, "down", camera)
    add_poses(tape, "mocap", reference, late=100.0)
    return tape.write(path)
