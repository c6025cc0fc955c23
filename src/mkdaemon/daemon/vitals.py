"""What the daemon knows about the vehicle, and how old that knowledge is."""

from __future__ import annotations

from typing import Final, NamedTuple

from mkdaemon.protocol.wire import Board
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.state import Flight, Pilot
from mkdaemon.telemetry.vehicle import VehicleHealth

MOTORS_AGE: Final = 2.0
"""Knowledge about the motors older than this is none [s]."""
TEST_LASTS: Final = 1.0
"""A motor test turns motors for 0.5 s, and the last message that shows them turning may be as old again [s]."""
PROOF_AGE: Final = 10.0
"""A version reply older than this proves no longer who is on the line [s]."""


class _Motors(NamedTuple):
    running: bool
    at: float


class Vitals:
    """Latest facts, each with its time; told by the sink, asked by the gate and by control."""

    def __init__(self, note: str) -> None:
        self.link: LinkState | None = None
        self._note = note
        self._motors: _Motors | None = None
        self._flight: Flight | None = None
        self._pilot: Pilot | None = None
        self._tested_at: float | None = None
        self._proof: tuple[Board, float] | None = None
        self._firmware: dict[str, str] = {}

    def motors_said(self, running: bool, at: float) -> None:
        """A message told whether motors run."""
        self._motors = _Motors(running, at)

    def motor_test_sent(self, at: float) -> None:
        """Motors are about to turn because a client tests them."""
        self._tested_at = at

    def flight_said(self, flight: Flight) -> None:
        """A message told what the aircraft does."""
        self._flight = flight

    def pilot_said(self, pilot: Pilot) -> None:
        """A message told what the pilot does."""
        self._pilot = pilot

    def version_said(self, board: Board, release: str, at: float) -> None:
        """A board named itself: proof that it is on the line."""
        self._proof = (board, at)
        self._firmware[board.word] = release

    def link_said(self, state: LinkState) -> None:
        """The link changed; what was proven on another opening, or before a redirect, is proven no more."""
        before, self.link = self.link, state
        if before is None or before.openings != state.openings:
            self._firmware.clear()
        if before is None or (before.openings, before.redirected_to) != (state.openings, state.redirected_to):
            self._proof = None

    def motors_running(self, now: float) -> bool | None:
        """Whether motors run; None where nobody has said so lately."""
        if self._motors is None or now - self._motors.at > MOTORS_AGE:
            return None
        return self._motors.running

    def is_testing_motors(self, now: float) -> bool:
        """Whether motors that turn may turn because of a motor test."""
        return self._tested_at is not None and now - self._tested_at <= TEST_LASTS

    def is_flying(self, now: float) -> bool | None:
        """Whether it is in the air; None where nobody has said so lately."""
        if self._flight is None or now - self._flight.stamp.monotonic > MOTORS_AGE:
            return None
        return self._flight.is_flying

    def pilot_throttle(self, now: float) -> float | None:
        """The pilot's throttle [stick]; None where the boards do not tell it."""
        if self._pilot is None or now - self._pilot.stamp.monotonic > MOTORS_AGE:
            return None
        return self._pilot.throttle

    def is_proven(self, board: Board, now: float) -> bool:
        """Whether the last version reply, not long ago, came from this board."""
        return self._proof is not None and self._proof[0] == board and now - self._proof[1] <= PROOF_AGE

    def last_named(self) -> str:
        """Which board answered the last version request, in words for a refusal."""
        return "no board answered one" if self._proof is None else f"{self._proof[0].word} answered it"

    def health(self, stamp: Stamp, *, read_only: str | None) -> VehicleHealth:
        """The vehicle's signs of life."""
        link, flight = self.link, self._flight
        fresh = flight is not None and stamp.monotonic - flight.stamp.monotonic <= MOTORS_AGE
        return VehicleHealth(
            stamp=stamp,
            is_alive=link is not None and link.condition.hears_board,
            reason="the line has not been opened yet" if link is None else link.reason,
            boards=() if link is None else link.boards,
            firmware=dict(self._firmware),
            read_only=read_only,
            link="absent" if link is None else link.condition.value,
            motors_running=self.motors_running(stamp.monotonic),
            error=flight.error or None if flight is not None and fresh else None,
            note=self._note,
        )
