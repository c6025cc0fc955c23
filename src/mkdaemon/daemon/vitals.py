"""What the daemon knows about the vehicle, and how old that knowledge is."""

from __future__ import annotations

from typing import Final

from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.protocol.wire import Board
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.vehicle import VehicleHealth

PROOF_AGE: Final = 10.0
"""A version reply older than this proves no longer who is on the line [s]."""


class Vitals:
    """The facts about the vehicle, and who has proven to be on the line.

    Attributes:
        facts: motors, flight, pilot and link.
    """

    def __init__(self, note: str) -> None:
        self.facts = VehicleFacts()
        self._note = note
        self._proof: tuple[Board, float] | None = None
        self._firmware: dict[str, str] = {}

    @property
    def link(self) -> LinkState | None:
        """The latest verdict on the line; None before the first."""
        return self.facts.link

    def motors_said(self, running: bool, at: float) -> None:
        """A message told whether motors run."""
        self.facts.motors_reported(running, at)

    def motor_test_sent(self, at: float) -> None:
        """Motors are about to turn because a client tests them."""
        self.facts.motor_test_sent(at)

    def version_said(self, board: Board, release: str, at: float) -> None:
        """A board named itself: proof that it is on the line."""
        self._proof = (board, at)
        self._firmware[board.word] = release

    def link_said(self, state: LinkState) -> None:
        """The link changed; what was proven on another opening, or before a redirect, is proven no more."""
        before = self.facts.link
        self.facts.link_changed(state)
        if before is None or before.openings != state.openings:
            self._firmware.clear()
        if before is None or (before.openings, before.redirected_to) != (state.openings, state.redirected_to):
            self._proof = None

    def motors_running(self, now: float) -> bool | None:
        """Whether motors run; None where nobody has said so lately."""
        return self.facts.motors_running(now)

    def is_testing_motors(self, now: float) -> bool:
        """Whether motors that turn may turn because of a motor test."""
        return self.facts.is_testing_motors(now)

    def is_proven(self, board: Board, now: float) -> bool:
        """Whether the last version reply, not long ago, came from this board."""
        return self._proof is not None and self._proof[0] == board and now - self._proof[1] <= PROOF_AGE

    def last_named(self) -> str:
        """Which board answered the last version request, in words for a refusal."""
        return "no board answered one" if self._proof is None else f"{self._proof[0].word} answered it"

    def health(self, stamp: Stamp, *, read_only: str | None) -> VehicleHealth:
        """The vehicle's signs of life."""
        link, flight = self.link, self.facts.flight(stamp.monotonic)
        return VehicleHealth(
            stamp=stamp,
            is_alive=link is not None and link.condition.hears_board,
            reason="the line has not been opened yet" if link is None else link.reason,
            boards=() if link is None else link.boards,
            firmware=dict(self._firmware),
            read_only=read_only,
            link="absent" if link is None else link.condition.value,
            motors_running=self.motors_running(stamp.monotonic),
            error=None if flight is None else flight.error or None,
            note=self._note,
        )
