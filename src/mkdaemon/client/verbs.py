"""Verbs of the daemon as methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mkdaemon.client.transport import Transport

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import LeaseState, ReleaseOutcome


@dataclass(frozen=True, slots=True)
class ReleaseResult:
    """What became of a release.

    Attributes:
        outcome: how it ended; `mkdaemon.telemetry.control` says what each means.
        fields: the daemon's whole reply.
    """

    outcome: ReleaseOutcome
    fields: dict[str, Any]

    @classmethod
    def from_reply(cls, reply: dict[str, Any]) -> ReleaseResult:
        """Read the daemon's reply."""
        from mkdaemon.telemetry.control import ReleaseOutcome

        return cls(ReleaseOutcome(reply["status"]), reply)

    @property
    def is_done(self) -> bool:
        """It was confirmed, or cannot be."""
        from mkdaemon.telemetry.control import ReleaseOutcome

        return self.outcome in {ReleaseOutcome.CONFIRMED, ReleaseOutcome.NOT_OBSERVABLE}


class Verbs(Transport):
    """Asks the daemon itself."""

    async def release(self, reason: str = "asked for by a client") -> ReleaseResult:
        """Let go of the aircraft, now, whoever flies: neutral sticks, then the pilot's sticks rule again.

        Needs no lease. It does not stop motors.

        Args:
            reason: published with the event.

        Raises:
            CommandRejectedError: no end of it in time.
            MkError: no daemon speaks for this vehicle.
        """
        return ReleaseResult.from_reply((await self.command("do", "release", {"reason": reason})).require())

    async def abort(self, reason: str = "asked for by a client") -> None:
        """Stop the manoeuvre that is flown, whoever flies: the aircraft holds its place, or is level without a target.

        The lease goes on: the aircraft is held as long as its holder streams, and released when he stops.

        Args:
            reason: published with the event.

        Raises:
            CommandRejectedError: `nothing_flown`.
            MkError: no daemon speaks for this vehicle.
        """
        (await self.command("do", "abort", {"reason": reason})).require()

    async def lease_state(self) -> LeaseState | None:
        """Who holds the lease; None for nobody.

        Raises:
            MkError: no daemon speaks for this vehicle.
        """
        from mkdaemon.telemetry.control import LeaseState

        reply = (await self.command("do", "lease", {"action": "show"})).require()
        return LeaseState.model_validate(reply) if reply else None

    async def rates(self) -> dict[str, float]:
        """Time between two frames of each stream that is asked for [s].

        Raises:
            MkError: no daemon speaks for this vehicle.
        """
        reply = (await self.command("do", "rate")).require()
        return dict(reply["intervals"])

    async def rate(self, stream: str, interval: float) -> dict[str, float]:
        """Ask for a telemetry stream at an interval.

        Args:
            stream: key of the message, for example `osd`, `attitude`, `debug`.
            interval: time between two frames [s]; 0 stops the stream.

        Returns:
            The intervals of all streams [s].

        Raises:
            CommandRejectedError: there is no such stream, or the line cannot carry it.
            MkError: no daemon speaks for this vehicle.
        """
        reply = (await self.command("do", "rate", {"stream": stream, "interval": interval})).require()
        return dict(reply["intervals"])

    async def labels(self, board: str) -> tuple[str, ...]:
        """Names of a board's 32 debug channels.

        Args:
            board: `fc`, `nc` or `mag`.

        Raises:
            CommandRejectedError: the board did not answer, or cannot be reached.
            MkError: no daemon speaks for this vehicle.
        """
        reply = (await self.command("do", "labels", {"board": board}, patience=60.0)).require()
        return tuple(reply["names"])

    async def schema(self, name: str) -> dict[str, Any] | None:
        """The JSON Schema of a payload; None for an unknown name.

        Args:
            name: name and version, as an encoding names them: `Attitude.v1`.

        Raises:
            MkError: the name is no part of a key.
        """
        suffix = f"schema/{name}"
        sample = (await self.get_all(suffix)).get(suffix)
        return None if sample is None else sample.fields
