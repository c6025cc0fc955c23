"""Setpoints of one lease: checked here as the daemon checks them, numbered, and put on the bus."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from mkdaemon.client.transport import SetpointPublisher, Transport
from mkdaemon.errors import MkError

if TYPE_CHECKING:
    from pydantic import BaseModel


class Setpoints:
    """Streams setpoints of every kind under one lease.

    Attributes:
        sequence: number of the last setpoint; counts up over all kinds.
    """

    def __init__(self, transport: Transport, epoch: int, secret: str) -> None:
        self.sequence = 0
        self._transport = transport
        self._epoch = epoch
        self._secret = secret
        self._publishers: dict[str, tuple[SetpointPublisher, str]] = {}

    def check(self, kind: str, ttl: float, fields: Mapping[str, Any]) -> BaseModel:
        """Make a setpoint of a kind, as the next one.

        Raises:
            CommandRejectedError: `bad_field`: a field is missing, unknown or out of range.
            MkError: there is no such kind.
        """
        from pydantic import ValidationError

        from mkdaemon.bus.codec import first_mistake
        from mkdaemon.telemetry.refusals import Token, refuse

        model = _models().get(kind)
        if model is None:
            msg = f"there is no setpoint {kind!r}; there is {', '.join(_models())}"
            raise MkError(msg)
        try:
            return model.model_validate({**fields, "epoch": self._epoch, "sequence": self.sequence + 1, "ttl": ttl})
        except ValidationError as error:
            raise refuse(Token.BAD_FIELD, name=model.__name__, detail=first_mistake(error)) from error

    def put(self, kind: str, ttl: float, fields: Mapping[str, Any]) -> None:
        """Check a setpoint, sign it and put it.

        Raises:
            CommandRejectedError: `bad_field`.
            MkError: there is no such kind.
        """
        from mkdaemon.bus.codec import encode, encoding_of
        from mkdaemon.telemetry.signature import sign

        setpoint = self.check(kind, ttl, fields)
        if kind not in self._publishers:
            self._publishers[kind] = (self._transport.stream(f"setpoint/{kind}"), encoding_of(type(setpoint)))
        publisher, encoding = self._publishers[kind]
        self.sequence += 1
        payload = encode(setpoint)
        publisher.put(payload, encoding=encoding, attachment=sign(self._secret, f"setpoint/{kind}", payload))


@cache
def _models() -> dict[str, type[BaseModel]]:
    """Every kind of setpoint of the table of keys."""
    from mkdaemon.bus.keys import Use, of_use

    return {spec.suffix.removeprefix("setpoint/"): spec.carries for spec in of_use(Use.SETPOINT) if spec.carries}
