"""Drives the manoeuvre that is flown, without authority and output."""

from __future__ import annotations

from dataclasses import replace

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.admission.rows import refusal
from mkdaemon.control.estimator.model import H, P
from mkdaemon.control.flown import Flown
from mkdaemon.control.manoeuvres.table import MANOEUVRES
from mkdaemon.control.preflight import Preflight
from mkdaemon.control.sight import Sight, view_of
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.telemetry.control import Phase


def placed(estimate, position):
    """The same aircraft elsewhere."""
    axes, vertical = estimate.axes.copy(), estimate.vertical.copy()
    axes[:, P], vertical[H] = position[:2], position[2]
    return replace(estimate, axes=axes, vertical=vertical)


class Flying:
    """A sight, and what is flown by it."""

    def __init__(self, cfg=None, rows=MANOEUVRES) -> None:
        self.cfg = cfg or ControlConfig()
        self.sight = Sight(self.cfg.autopilot, -2.0)
        self.facts = VehicleMemory()
        self.flown = Flown(self.cfg, self.sight, rows)
        self._preflight = Preflight(self.cfg, self.facts)
        self._preflight.compute_loop()

    def admit(self, setpoint, phase, now):
        """Ask admission as the core does."""
        change = self.flown.change(setpoint, phase)
        if change is not None:
            wanted, before = change
            error = refusal(wanted, self._situation(before, now))
            if error is not None:
                raise error
            self.flown.admitted(wanted)

    def _situation(self, flown, now):
        found = self._preflight.situation(now, Phase.LEASED, None, self.flown, self.sight)
        return replace(found, flown=flown, entry=self.sight.entry(now))

    def see(self, pose, now, *, may_change=True):
        """A pose arrives."""
        return self.sight.view_received(pose.target, view_of(pose), now, lifted=None, may_change=may_change)

    def step(self, setpoint, now, *, is_flying=False, phase=Phase.FLYING):
        """What is wanted for a setpoint."""
        flown = self.flown.concern if is_flying and phase is not Phase.UNANSWERED else None
        return self.flown.step(setpoint, phase if is_flying else Phase.LEASED, self._situation(flown, now))
