"""What keeps the boards busy: a procedure, a lease that is being taken, a live set that is not proven."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mkdaemon.daemon.procedures.journal import Note
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.procedure import ProcedureProgress
from mkdaemon.telemetry.refusals import Token, refuse


class Interlock:
    """Keeps flying and procedures apart, and both away from a live set that is not proven.

    Attributes:
        running: the procedure under way.
        is_alone: whether it excludes flying.
        owed: note of the live set that has to be proven first.
        detail: what has become of that so far.
    """

    def __init__(self, phase: Callable[[], Phase]) -> None:
        """Begin with nothing under way.

        Args:
            phase: tells where authority stands.
        """
        self.running: ProcedureProgress | None = None
        self.is_alone = False
        self.owed: Note | None = None
        self.detail = "the FlightCtrl has not been met yet"
        self._phase = phase
        self._leases = 0

    @contextmanager
    def taking_lease(self) -> Iterator[None]:
        """Keep procedures away while a lease is being taken.

        Raises:
            CommandRejectedError: `busy` or `live_set_owed`.
        """
        self._check_owed("a lease")
        if self.is_alone:
            self._check_running()
        self._leases += 1
        try:
            yield
        finally:
            self._leases -= 1

    def check_request(self, board: Board, name: str, is_slow: bool) -> None:
        """Refuse a single dangerous request that would disturb a procedure or whoever flies, or an unproven FlightCtrl.

        Args:
            board: who is asked.
            name: of the request.
            is_slow: stick frames do not reach the aircraft meanwhile, and the last tilt would come back afterwards.

        Raises:
            CommandRejectedError: `flying`, `busy` or `live_set_owed`.
        """
        if is_slow and (self._leases or self._phase() is not Phase.FREE):
            raise refuse(Token.FLYING, name=f"{board.word}/{name}", phase=self._shown_phase())
        if board is Board.FC:
            self._check_owed("this request")
        self._check_running()

    def check_procedure(self, verb: str, *, is_alone: bool, needs_live_set: bool) -> None:
        """Refuse a procedure that cannot begin now.

        Args:
            verb: its name.
            is_alone: it excludes flying.
            needs_live_set: it must not begin before the live set is proven.

        Raises:
            CommandRejectedError: `busy`, `live_set_owed` or `flying`.
        """
        if needs_live_set:
            self._check_owed(verb)
        self._check_running()
        if is_alone and (self._leases or self._phase() is not Phase.FREE):
            raise refuse(Token.FLYING, name=verb, phase=self._shown_phase())

    def _shown_phase(self) -> str:
        return (Phase.LEASED if self._leases else self._phase()).value

    def _check_running(self) -> None:
        if self.running is not None:
            who = f" for {self.running.holder}" if self.running.holder else ""
            raise refuse(Token.BUSY, detail=f"{self.running.verb}{who} is under way ({self.running.id})")

    def _check_owed(self, name: str) -> None:
        if self.owed is not None:
            raise refuse(Token.LIVE_SET_OWED, name=name, slot=self.owed.active, verb=self.owed.verb, detail=self.detail)
