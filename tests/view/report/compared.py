"""Recordings of a camera and a reference of which every pose is known."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mkdaemon.frames import quaternion_from_rotation
from mkdaemon.view.report.alignment import PoseTrack
from tests.view.report.known import Tape
from tests.view.report.posed import RIGHT, Wrong, pose_fields, tracks

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
