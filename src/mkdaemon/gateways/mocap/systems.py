"""Motion capture systems, as the library `motioncapture` connects to them.

Source: libmotioncapture 1.1, `connect(type, {"hostname": ...})`, `waitForNextFrame()`, `rigidBodies`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from mkdaemon.errors import ConfigError


@dataclass(frozen=True, slots=True)
class MocapSystem:
    """A kind of system.

    Attributes:
        word: on the command line.
        kind: word of the library.
        about: what it is.
    """

    word: str
    kind: str
    about: str


SYSTEMS: Final = (
    MocapSystem("vicon", "vicon", "Vicon Tracker, Nexus, Shogun: DataStream"),
    MocapSystem("optitrack", "optitrack", "OptiTrack Motive: NatNet, open protocol"),
    MocapSystem("qualisys", "qualisys", "Qualisys Track Manager: real-time protocol"),
    MocapSystem("vrpn", "vrpn", "any VRPN server"),
    MocapSystem("fzmotion", "fzmotion", "FZMotion; a motioncapture built with its SDK"),
)
"""Every kind; a further one is a line."""
UNKNOWN: Final = "Unknown motion capture type"
"""What the library says of a kind that it was built without."""


@dataclass(frozen=True, slots=True)
class BodyPose:
    """A body in one measurement.

    Attributes:
        position: [m].
        quaternion: (w, x, y, z).
    """

    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


Frames = Callable[[], Iterator[dict[str, BodyPose]]]
"""Connects and yields every measurement: the bodies that are seen in it, by name."""


def find_system(word: str) -> MocapSystem:
    """The system of a word.

    Raises:
        ConfigError: there is none; it lists all.
    """
    for system in SYSTEMS:
        if system.word == word:
            return system
    raise ConfigError(f"{word!r} is no motion capture system: {', '.join(one.word for one in SYSTEMS)}")


def frames_of(library: Any, system: MocapSystem, host: str) -> Iterator[dict[str, BodyPose]]:
    """Connect, and yield every measurement; blocks.

    Args:
        library: the module `motioncapture`.
        system: kind.
        host: name or address.

    Raises:
        ConfigError: this library does not know that kind.
        RuntimeError: it cannot connect, or lost the system.
    """
    try:
        source = library.connect(system.kind, {"hostname": host})
    except RuntimeError as error:
        if UNKNOWN not in str(error):
            raise
        known = f"motioncapture {getattr(library, '__version__', '')} was built without {system.kind}"
        raise ConfigError(f"{known}: use another protocol of the system (vrpn), or build it from its source") from None
    while True:
        source.waitForNextFrame()
        poses = ((name, _pose(body)) for name, body in source.rigidBodies.items())
        yield {name: pose for name, pose in poses if pose is not None}


def _pose(body: Any) -> BodyPose | None:
    """Pose of a body; None of one that is hidden, which a system shows by numbers that are none, or by zeros."""
    x, y, z = (float(part) for part in body.position)
    turn = body.rotation
    w, i, j, k = float(turn.w), float(turn.x), float(turn.y), float(turn.z)
    length = math.hypot(w, i, j, k)
    if not math.isfinite(x + y + z + length) or not 0.9 < length < 1.1 or not any((x, y, z)):
        return None
    return BodyPose((x, y, z), (w, i, j, k))
