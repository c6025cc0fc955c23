"""What became of a command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mkdaemon.errors import CommandRejectedError


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a command.

    Attributes:
        status: accepted, denied, busy, unsupported, timeout, not_observable.
        reply: what the board or the daemon answered; empty where nothing.
        token: stable word of a refusal.
        reason: why it was refused.
        fix: what to do about it.
        duration: time the daemon took [s].
        reply_type: schema of the reply, for example `VersionFc210.v1`; names the layout the board spoke.
    """

    status: str
    reply: dict[str, Any]
    token: str | None = None
    reason: str | None = None
    fix: str | None = None
    duration: float | None = None
    reply_type: str | None = None

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Answer:
        """Read a `CommandResult` as it stands on the bus."""
        return cls(
            status=fields.get("status", "denied"),
            reply=fields.get("reply") or {},
            token=fields.get("token"),
            reason=fields.get("reason"),
            fix=fields.get("fix"),
            duration=fields.get("duration"),
            reply_type=fields.get("reply_type"),
        )

    @property
    def is_accepted(self) -> bool:
        """Whether it was done, or sent where success cannot be seen."""
        return self.status in {"accepted", "not_observable"}

    @property
    def refusal(self) -> CommandRejectedError:
        """The exception that a refused command raises."""
        return CommandRejectedError(self.token or self.status, self.reason or "no reason given.", self.fix or "")

    def require(self) -> dict[str, Any]:
        """Return the reply.

        Raises:
            CommandRejectedError: the command was refused; says token, reason and fix.
        """
        if not self.is_accepted:
            raise self.refusal
        return self.reply
