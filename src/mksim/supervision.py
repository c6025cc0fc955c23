"""The pilot hands the aircraft to a machine, watches, and takes it back.

On stock firmware the throttle of a `b` frame is limited by the pilot's own stick. Therefore, while a machine flies, the
pilot holds the throttle above hover; after a release the aircraft climbs until the pilot reacts. After the landing the
pilot lowers the throttle, so that the aircraft cannot lift again before the motors stop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mksim.physics.hand_flight import HandFlight, HandPhase
from mksim.physics.pilot import STICK_LIMIT, FlightView, SimulatedPilot

CEILING_GAS: Final = 15.0
"""Gas stick while a machine flies: a quarter more thrust than hover (about -2) to climb with."""
LANDED: Final = 0.5
"""Time on the ground that makes a landing."""


class Supervision:
    """Fly by hand until a machine takes over, rest the sticks while it flies, fly by hand again after its release.

    Attributes:
        flight: the flight by hand that runs, None while the machine flies or the pilot waits for it.
        take_overs: how often a machine took over.
    """

    def __init__(
        self,
        is_external: Callable[[], bool],
        *,
        take_off: bool = True,
        start_motors: bool = False,
        height: float = 2.0,
        reaction: float = 0.7,
        ceiling: float = CEILING_GAS,
    ) -> None:
        """Plan it.

        Args:
            is_external: whether the FlightCtrl follows a machine now.
            take_off: start by hand and hover; otherwise wait on the ground for the machine to do it.
            start_motors: on the ground, with `take_off` off: start them and wait, throttle down.
            height: to hover at, feet above the ground [m].
            reaction: time from noticing the machine's release to the hand on the sticks [s].
            ceiling: gas stick while the machine flies.
        """
        self._is_external = is_external
        self._reaction = reaction
        self._ceiling = ceiling
        self._released_at: float | None = None
        self._machine_flies = False
        self._has_flown = False
        self._down_since: float | None = None
        self.flight: HandFlight | None = HandFlight(height=height) if take_off else None
        if start_motors and not take_off:
            self.flight = HandFlight.starting()
        self.take_overs = 0

    def fly(self, pilot: SimulatedPilot, view: FlightView, now: float) -> None:
        """Move the sticks."""
        if self._is_external():
            self._rest_sticks(pilot, view, now)
        elif self._machine_flies:
            self._resume_control(view, now)
        if self.flight is not None:
            self.flight.fly(pilot, view, now)

    @property
    def doing(self) -> str:
        """What the pilot does, or waits for; see `Program`."""
        if self._machine_flies:
            return "rests the sticks while a machine flies, and takes over at its release"
        if self.flight is None:
            return "waits for a machine to start the motors and take off"
        if self.flight.phase is HandPhase.FLY:
            return "hovers by hand and waits for a machine: `mkctl stick`, `goto`, `land`"
        is_ready = self.flight.phase is HandPhase.DONE and not self.flight.is_over
        return f"{self.flight.doing}{' and waits for a machine: `mkctl take-off`, `fly`' if is_ready else ''}"

    @property
    def is_over(self) -> bool:
        """The motors are stopped; see `Program`."""
        return self.flight is not None and self.flight.is_over

    def _rest_sticks(self, pilot: SimulatedPilot, view: FlightView, now: float) -> None:
        """Rest the sticks, unless the pilot is still busy taking off, landing or starting motors."""
        is_ready = {HandPhase.FLY} if self.take_overs else {HandPhase.FLY, HandPhase.DONE}
        if self.flight is not None and self.flight.phase not in is_ready:
            return
        if not self._machine_flies:
            self._machine_flies = True
            self.take_overs += 1
        self._released_at = None
        self.flight = None
        pilot.set_sticks(gas=-STICK_LIMIT if self._has_landed(view, now) else self._ceiling)

    def _has_landed(self, view: FlightView, now: float) -> bool:
        """Say whether a flight of the machine is over: down for a while, motors not yet stopped."""
        if not view.motors_running:
            self._has_flown = False
        elif not view.airframe.on_ground:
            self._has_flown = True
            self._down_since = None
        elif self._down_since is None:
            self._down_since = now
        down_since = self._down_since
        return self._has_flown and down_since is not None and now - down_since > LANDED

    def _resume_control(self, view: FlightView, now: float) -> None:
        """After the reaction time, hover here; on the ground, stop the motors."""
        if self._released_at is None:
            self._released_at = now
        if now - self._released_at < self._reaction:
            return
        self._machine_flies = False
        airframe = view.airframe
        if airframe.on_ground:
            self.flight = HandFlight.stopping()
            return
        surface = airframe.ground.at(airframe.east, airframe.north, now)[0]
        self.flight = HandFlight(height=airframe.up - surface, flying=True)
