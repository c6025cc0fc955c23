"""The least of a FlightCtrl that lets a pilot fly the world: gas from the stick, arming corners, no serial line."""

from __future__ import annotations

from mksim.physics.pilot import SimulatedPilot
from mksim.physics.world import DT, StickInput, World

GAS_AT_REST = 127.0
"""Gas of a centred stick [count]."""
CORNER_TIME = 0.7


class RcBoard:
    """Mixes the pilot's sticks into the world."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.armed = False
        self.armings = 0
        self.height_control = False
        self.deaf_until = 0.0
        self._corner = 0.0

    def sticks(self) -> StickInput:
        pilot = self.world.pilot
        self._watch_corners(pilot)
        gas = max(0.0, min(254.0, GAS_AT_REST + pilot.gas))
        return StickInput(
            pilot.pitch,
            pilot.roll,
            pilot.yaw,
            gas,
            motors_running=self.armed,
            height_control=self.height_control,
        )

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / DT)):
            self.world.step(self.sticks())

    def _watch_corners(self, pilot: SimulatedPilot) -> None:
        corner = pilot.gas < -100 and abs(pilot.yaw) > 100 and self.world.now >= self.deaf_until
        self._corner = self._corner + DT if corner else 0.0
        if self._corner > CORNER_TIME and self.armed is (pilot.yaw > 0):
            self.armed = not self.armed
            self.armings += self.armed
            self._corner = 0.0
