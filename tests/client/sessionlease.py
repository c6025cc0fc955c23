"""A lease without a bus: a real flight session whose setpoints are kept, and whose daemon is the test."""

from __future__ import annotations

import asyncio
from typing import Any

from mkdaemon.client.session import FlightSession
from mkdaemon.errors import CommandRejectedError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import ControlStatus, HolderGrant, LeaseState, Phase
from mkdaemon.telemetry.event import CommandEvent
from mkdaemon.telemetry.setpoint import Setpoint

STAMP = Stamp(monotonic=0.0, wall=0.0)


def control_status(phase: Phase, epoch: int | None, **changes: Any) -> ControlStatus:
    """What a daemon reports of a lease."""
    lease = None if epoch is None else LeaseState(holder="me", epoch=epoch, ttl=5.0, left=5.0)
    fields = {"stamp": STAMP, "reason": "because", "setpoint_age": None, "refused": 0, "external_control": "v2"}
    return ControlStatus.model_validate({"phase": phase, "lease": lease} | fields | changes)


class SessionLease:
    """Stands for `Lease` in a `LeaseKeeper`; one object for every lease that is taken one after the other.

    Attributes:
        streamed: kind and given fields of every setpoint.
        engages: setpoints after which the daemon flies; 0 for at once, None for never.
        session: of the holder.
    """

    def __init__(self, epoch: int = 7, engages: int | None = 0) -> None:
        self.streamed: list[tuple[str, dict[str, Any]]] = []
        self.epoch, self.engages = epoch, engages
        self._session: FlightSession | None = None

    @property
    def session(self) -> FlightSession:
        assert self._session is not None
        return self._session

    @property
    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    def grant(self, session: FlightSession) -> None:
        """Give the lease to a session that asks for it."""
        self._session = session
        session.take()
        grant = HolderGrant(holder="me", epoch=self.epoch, ttl=5.0, left=5.0, secret="s")
        session.granted(grant, self._now)
        if self.engages == 0:
            self.report(Phase.FLYING)

    def report(self, phase: Phase, **changes: Any) -> None:
        """Let the daemon report of this lease."""
        self.session.status_arrived(control_status(phase, self.epoch, **changes), self._now)

    def lose(self, reason: str, **changes: Any) -> None:
        """Let the daemon report that the lease has ended."""
        self.report(Phase.STALE)
        self.session.status_arrived(control_status(Phase.FREE, None, reason=reason, **changes), self._now)

    def refuse(self, error: CommandRejectedError) -> None:
        """Let the daemon refuse a setpoint."""
        fields = {"key": "setpoint/stick", "fields": {"epoch": self.epoch}, "status": "denied"}
        words = {"token": error.token, "reason": error.reason, "fix": error.fix}
        self.session.event_arrived(CommandEvent.model_validate({"stamp": STAMP} | fields | words), self._now)

    def send(self, setpoint: Setpoint | None) -> None:
        """Keep a setpoint."""
        self.session.sign_of_life(self._now)
        if setpoint is None:
            return
        numbers = {"epoch", "sequence", "ttl", "after_abort"}
        self.streamed.append((setpoint.kind, setpoint.model_dump(exclude_unset=True, exclude=numbers)))
        if self.engages and len(self.streamed) >= self.engages and not self.session.is_engaged:
            self.report(Phase.FLYING, manoeuvre=setpoint.kind)
