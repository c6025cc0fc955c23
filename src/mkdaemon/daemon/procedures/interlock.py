"""Work that keeps the boards busy, and requests meanwhile; admission decides about them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from mkdaemon.control.admission.beginnings import Beginning, TakeLease
from mkdaemon.control.admission.rows import refusal
from mkdaemon.control.admission.situation import OwedLiveSet, Situation, Work
from mkdaemon.daemon.procedures.journal import Note
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.procedure import ProcedureProgress


class Interlock:
    """Adds to the situation of the flight core what the daemon knows: procedures, live sets, leases being taken.

    Attributes:
        running: the procedure under way.
        is_alone: whether it excludes flying.
        owed: note of the live set that has to be proven first.
        detail: what is known about its recovery.
    """

    def __init__(self, situation: Callable[[], Situation]) -> None:
        """Begin with nothing under way.

        Args:
            situation: what the flight core knows now.
        """
        self.running: ProcedureProgress | None = None
        self.is_alone = False
        self.owed: Note | None = None
        self.detail = "the FlightCtrl has not been met yet"
        self._situation = situation
        self._leases = 0

    def refusal(self, beginning: Beginning, **known: Any) -> CommandRejectedError | None:
        """Say why something must not begin now; None where it may.

        Args:
            beginning: what is to begin.
            known: fields of the situation that the caller knows better.
        """
        owed = None if self.owed is None else OwedLiveSet(self.owed.active, self.owed.verb, self.detail)
        work = Work(self.running, self.is_alone, owed, self._leases)
        return refusal(beginning, replace(self._situation(), work=work, **known))

    def require(self, beginning: Beginning, **known: Any) -> None:
        """Go on only where something may begin now; see `refusal`.

        Raises:
            CommandRejectedError: why it must not.
        """
        error = self.refusal(beginning, **known)
        if error is not None:
            raise error

    @contextmanager
    def taking_lease(self, path_delay: float | None = None) -> Iterator[None]:
        """Keep procedures away while a lease is being taken.

        Args:
            path_delay: the way to the client and back [s]; None where it has not been measured.

        Raises:
            CommandRejectedError: `slow_path`, `busy` or `live_set_owed`.
        """
        self.require(TakeLease(path_delay=path_delay, is_early=True))
        self._leases += 1
        try:
            yield
        finally:
            self._leases -= 1
