"""Drives the manoeuvre that is flown, without authority and output."""

from __future__ import annotations

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.flown import Flown
from mkdaemon.control.manoeuvres.table import MANOEUVRES
from mkdaemon.control.sight import Sight, view_of
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.telemetry.control import Phase


class Flying:
    """A sight, and what is flown by it; everything is admitted, or what `refusal` says."""

    def __init__(self, cfg=None, rows=MANOEUVRES) -> None:
        self.cfg = cfg or ControlConfig()
        self.sight = Sight(self.cfg.autopilot, -2.0)
        self.facts = VehicleMemory()
        self.refusal = None
        self.asked = []
        self.flown = Flown(self.cfg, self.sight, self.facts, rows, self._admit)

    def _admit(self, kind, before, now):
        self.asked.append(kind)
        return self.refusal

    def see(self, pose, now, *, may_change=True):
        """A pose arrives."""
        return self.sight.view_received(pose.target, view_of(pose), now, lifted_by=None, may_change=may_change)

    def step(self, setpoint, now, *, is_flying=False, phase=Phase.FLYING):
        """What is wanted for a setpoint."""
        return self.flown.step(setpoint, phase if is_flying else Phase.LEASED, now, is_flying=is_flying)
