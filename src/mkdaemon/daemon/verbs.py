"""What the daemon itself can be asked for: `do/<verb>`."""

from __future__ import annotations

import difflib
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from mkdaemon.bus.codec import decode_map, read_command, schema_name
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.flight import FlightControl
from mkdaemon.daemon.procedures import Occupancy
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.link import Link
from mkdaemon.telemetry.command import CommandResult, LeaseRequest, RateRequest, Rates, refused
from mkdaemon.telemetry.refusals import Status, Token, refuse

Verb = Callable[[bytes], Awaitable[CommandResult]]


class Verbs:
    """Answers queries under `do/`."""

    def __init__(
        self, flight: FlightControl, link: Link, audit: Audit, occupancy: Occupancy, procedures: Mapping[str, Verb]
    ) -> None:
        self._link = link
        self._flight = flight
        self._audit = audit
        self._occupancy = occupancy
        self._verbs: dict[str, Verb] = {
            "lease": self._lease,
            "release": flight.release,
            "rate": self._rate,
            **procedures,
        }

    async def answer(self, suffix: str, raw: bytes) -> CommandResult:
        """Answer one query; every one is mirrored under `event/command`, whatever becomes of it."""
        fields: dict[str, Any] = {}
        name = suffix.removeprefix("do/")
        try:
            fields = decode_map(raw)
            verb = self._verbs.get(name)
            if verb is None:
                near = difflib.get_close_matches(name, self._verbs, n=1, cutoff=0.4) or list(self._verbs)
                raise refuse(Token.UNKNOWN_VERB, name=name, near=" or ".join(near))
            result = await verb(raw)
        except CommandRejectedError as error:
            result = refused(error)
        self._audit.command(suffix, fields, result)
        return result

    async def _lease(self, raw: bytes) -> CommandResult:
        """Answer `do/lease`; nobody takes one while a procedure needs the boards."""
        if read_command(LeaseRequest, raw).action != "take":
            return await self._flight.lease(raw)
        with self._occupancy.taking_lease():
            return await self._flight.lease(raw)

    async def _rate(self, raw: bytes) -> CommandResult:
        """Answer `do/rate`: change one stream, or just show all."""
        request = read_command(RateRequest, raw)
        if request.stream is not None and request.interval is not None:
            self._link.set_rate(request.stream, request.interval)
        rates = Rates(intervals=self._link.rates())
        return CommandResult(status=Status.ACCEPTED, reply=dict(rates), reply_type=schema_name(Rates))
