"""What became of a command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from mkdaemon.errors import CommandRejectedError, ProtocolError
from mkdaemon.telemetry.refusals import TOKENS
from mkdaemon.telemetry.status import Status

if TYPE_CHECKING:
    from pydantic import BaseModel

_Model = TypeVar("_Model", bound="BaseModel")


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a command.

    Attributes:
        status: how it ended.
        reply: what the board or the daemon answered; empty where nothing.
        token: stable word of a refusal; a `Token` where this version knows it.
        reason: why it was refused.
        fix: what to do about it.
        duration: time the daemon took [s].
        reply_type: schema of the reply, for example `VersionFc210.v1`; names the layout the board spoke.
    """

    status: Status
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
            status=Status(fields.get("status", Status.DENIED)),
            reply=fields.get("reply") or {},
            token=_token(fields.get("token")),
            reason=fields.get("reason"),
            fix=fields.get("fix"),
            duration=fields.get("duration"),
            reply_type=fields.get("reply_type"),
        )

    @property
    def is_accepted(self) -> bool:
        """Whether it was done, or sent where success cannot be seen."""
        return self.status in {Status.ACCEPTED, Status.NOT_OBSERVABLE}

    @property
    def refusal(self) -> CommandRejectedError:
        """The exception that a refused command raises."""
        return CommandRejectedError(self.token or self.status, self.reason or "no reason given.", self.fix or "")

    def as_a(self, model: type[_Model]) -> _Model:
        """Return the reply as a value.

        Args:
            model: what it is.

        Raises:
            CommandRejectedError: the command was refused.
            ProtocolError: the reply is no such value.
        """
        from pydantic import ValidationError

        reply = self.require()
        try:
            return model.model_validate(reply)
        except ValidationError as error:
            what = ", ".join(reply) or "nothing"
            raise ProtocolError(f"{what} is no {model.__name__}; update mkdaemon here or there") from error

    def require(self) -> dict[str, Any]:
        """Return the reply.

        Raises:
            CommandRejectedError: the command was refused; says token, reason and fix.
        """
        if not self.is_accepted:
            raise self.refusal
        return self.reply


def _token(word: str | None) -> str | None:
    """The token of a word, or the word where a newer daemon says one that is not known here."""
    return None if word is None else TOKENS.get(word, word)
