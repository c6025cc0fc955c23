"""The toy aircraft of `lab fuzz --core`, and how it is swung by hand."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from mkdaemon.control.actions import SendSticks
from mkdaemon.control.estimator.model import GRAVITY
from mkdaemon.control.estimator.values import GAS_CENTRE

STAND: Final = 0.10
"""Height of the body above the target when the feet stand [m]."""
HOVER: Final = 125.0
"""Throttle that carries the toy [count of 254]."""
TILT: Final = math.radians(0.451)
"""Tilt that a stick count asks for [rad]."""
LAG: Final = 0.3
"""Of that tilt [s]."""
DEAD_MAN: Final = 0.5
"""The toy obeys a stick frame for this long [s]."""
SWUNG: Final = 4.2
"""It is swung for this long before the client asks for anything, and a second longer [s]."""


class Toy:
    """An aircraft that obeys stick frames; while none come, its pilot hovers it over the target.

    Attributes:
        place, velocity, tilt: [m], [m/s], [rad].
        runs: the motors turn.
        gate_is_open: stick frames act.
        lid: the pilot's throttle, which caps that of stick frames [stick].
        sent: the newest stick frame, and when it came [s].
        stood_since: since when the feet stand [s]; infinite while they do not.
    """

    def __init__(self, height: float) -> None:
        self.place, self.velocity, self.tilt = [0.0, 0.0, height], [0.0, 0.0, 0.0], [0.0, 0.0]
        self.runs = self.gate_is_open = True
        self.lid = 80.0
        self.sent: tuple[float, SendSticks] | None = None
        self.stood_since = math.inf

    @property
    def stands(self) -> bool:
        """Whether the feet stand."""
        return self.place[2] <= STAND

    def step(self, now: float, dt: float) -> None:
        """Move on."""
        place, velocity, tilt = self.place, self.velocity, self.tilt
        frame = self.sent[1].counts if self.sent is not None and now - self.sent[0] < DEAD_MAN else None
        if frame is None or not self.gate_is_open:
            lift = 0.0 if self.stands else GRAVITY - 2.0 * velocity[2] - 1.0 * max(min(place[2] - 1.5, 0.5), -0.5)
            asked = [max(min(-0.3 * velocity[axis] - 0.15 * place[axis], 0.3), -0.3) for axis in (0, 1)]
        else:
            lift = GRAVITY * (max(min(frame.throttle, self.lid) + GAS_CENTRE, 0.0) / HOVER) ** 2
            asked = [TILT * frame.pitch, -TILT * frame.roll]
        for axis in (0, 1):
            tilt[axis] += (asked[axis] - tilt[axis]) * min(dt / LAG, 1.0)
            velocity[axis] += (GRAVITY * math.tan(tilt[axis]) - 0.35 * velocity[axis]) * dt
        velocity[2] += (lift * self.runs - GRAVITY) * dt
        for axis in range(3):
            place[axis] += velocity[axis] * dt
        if place[2] <= STAND:
            place[2], self.velocity, self.tilt = STAND, [0.0, 0.0, max(velocity[2], 0.0)], [0.0, 0.0]
            self.stood_since = min(self.stood_since, now)
        else:
            self.stood_since = math.inf


class Swing(NamedTuple):
    """How a pilot swings the aircraft over the target to test its camera.

    Attributes:
        since: when it began [s].
        sense: of what images show; -1 for a camera that is mounted the wrong way round.
        late: error of their time stamps [s].
    """

    since: float
    sense: float
    late: float

    def is_over(self, now: float) -> bool:
        """Whether it has lasted for long enough to be compared: from then on the client asks."""
        return now - self.since > SWUNG

    def seen(self, at: float) -> float:
        """Pitch in an image of a time [s], nose down positive [rad]."""
        return self.sense * swung(at - self.late)


def swung(at: float) -> float:
    """Pitch of an aircraft that is swung, at a time [s], nose down positive [rad]."""
    return math.radians(3.0) * (math.sin(math.tau * 1.1 * at) + math.sin(math.tau * 1.7 * at))
