"""An aircraft that is where the test puts it, the target that its camera sees, and one manoeuvre that is asked."""

from __future__ import annotations

import numpy as np

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.sight import Sight
from tests.control.estimator.test_parts import level_view

STEP = 0.02
"""Time between two steps [s]."""
CFG = AutopilotConfig()


def view(at, place, yaw=0.0):
    """What an image shows of a target from a place (3,) [m], level, at a heading [rad]."""
    return level_view(at, place=place, yaw=yaw, covariance=1e-4 * np.eye(6))


class Hovering:
    """Keeps still at `place`; an image arrives every other step while `sees`."""

    def __init__(self, place=(0.0, 0.0, 2.0), *, yaw=0.0, cfg=CFG):
        self.place, self.yaw, self.cfg = place, yaw, cfg
        self.sight = Sight(cfg, -2.0)
        self.now, self.sees = 1000.0, True  # the clock of a machine that has run for a while
        self._count = 0

    def look(self, target="pad"):
        """An image of the target arrives now."""
        seen = view(self.now, self.place, self.yaw)
        self.sight.view_received(target, seen, self.now, lifted=None, may_change=True)

    def watch(self, seconds):
        """Only images arrive: the estimate settles."""
        for _ in range(round(seconds / STEP)):
            self._pass_time()
        return self

    def fly(self, manoeuvre, seconds, *, is_flying=True):
        """Ask a manoeuvre for a time; returns what it wanted at each step."""
        steps = []
        for _ in range(round(seconds / STEP)):
            self._pass_time()
            steps.append(manoeuvre.step(self.now, is_flying=is_flying))
        return steps

    def begin(self, manoeuvre, before=None):
        """Let a manoeuvre begin after another one."""
        manoeuvre.enter(before, self.now)
        return manoeuvre

    def _pass_time(self):
        self.now = round(self.now + STEP, 6)
        self._count += 1
        if self.sees and self._count % 2 == 0:
            self.look()
