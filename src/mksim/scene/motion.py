"""How a landing platform moves: standing, straight, in a circle, or up a speed ramp; it may rock like a deck."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mkdaemon.frames import rotation_from_euler
from mksim.scene.view import ViewPose

MotionKind = Literal["still", "straight", "circle", "ramp"]


@dataclass(frozen=True, slots=True)
class Platform:
    """A platform that moves and faces along its path.

    Attributes:
        kind: `still`; `straight` at `speed` along `heading`; `circle` of `radius` at `speed`, counter-clockwise;
            `ramp` from rest at `acceleration` up to `speed`, then straight.
        start_enu: where it is at time 0 [m].
        heading: direction of its x axis at time 0, counter-clockwise from east [rad].
        speed: [m/s].
        radius: of the circle [m].
        acceleration: of the ramp [m/s^2].
        roll: rest attitude, for slanted decks and walls [rad].
        pitch: as `roll`, nose down positive [rad].
        rocking: amplitude of roll and pitch about the rest attitude [rad].
        rocking_period: of the roll [s]; the pitch takes 1.3 times as long.
        delay: time at its start before it moves [s].
    """

    kind: MotionKind = "still"
    start_enu: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0
    speed: float = 0.0
    radius: float = 2.0
    acceleration: float = 0.2
    roll: float = 0.0
    pitch: float = 0.0
    rocking: float = 0.0
    rocking_period: float = 4.0
    delay: float = 0.0

    def pose_at(self, time: float) -> ViewPose:
        """Pose in the world at `time` [s]."""
        heading, time = self.heading, max(time - self.delay, 0.0)
        start = np.array(self.start_enu)
        if self.kind == "circle":
            # p = start + r (sin(a) ahead + (1 - cos(a)) side), a = v t / r: tangent to the heading at the start.
            turned = self.speed * time / self.radius
            side = np.array([-np.sin(heading), np.cos(heading), 0.0])
            ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
            position = start + self.radius * (np.sin(turned) * ahead + (1.0 - np.cos(turned)) * side)
            heading += turned
        else:
            position = start + self._travelled(time) * np.array([np.cos(heading), np.sin(heading), 0.0])
        phase = 2.0 * np.pi * time / self.rocking_period
        roll = self.roll + self.rocking * np.sin(phase)
        pitch = self.pitch + self.rocking * np.sin(phase / 1.3 + 1.0)
        return ViewPose(rotation_from_euler(float(roll), float(pitch), heading), position)

    def _travelled(self, time: float) -> float:
        """Way along a straight path [m]."""
        if self.kind == "still":
            return 0.0
        if self.kind == "straight" or self.acceleration <= 0.0:
            return self.speed * time
        rising = float(np.clip(time, 0.0, self.speed / self.acceleration))
        return 0.5 * self.acceleration * rising**2 + self.speed * max(time - rising, 0.0)
