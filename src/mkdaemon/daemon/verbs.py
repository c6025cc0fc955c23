"""What the daemon itself can be asked for: `do/<verb>`."""

from __future__ import annotations

import difflib
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import asdict
from typing import Any

from mkdaemon.bus.codec import Payload, read_command, schema_name
from mkdaemon.daemon.answering import answer_query
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.flight import FlightControl
from mkdaemon.daemon.pathdelay import PathProbe
from mkdaemon.daemon.procedures import Interlock
from mkdaemon.daemon.releases import RELEASE_TIMEOUT
from mkdaemon.link.link import Link
from mkdaemon.telemetry.command import (
    AbortRequest,
    CommandResult,
    GainsRequest,
    LeaseRequest,
    PreflightRequest,
    Rates,
    RatesRequest,
    ReleaseRequest,
)
from mkdaemon.telemetry.control import Gains, LeaseGrant, LeaseProbe, ReleaseOutcome, ReleaseReport
from mkdaemon.telemetry.preflight import PreflightReport
from mkdaemon.telemetry.record import MarkRequest
from mkdaemon.telemetry.refusals import Status, Token, refuse

Verb = Callable[[Payload], Awaitable[CommandResult]]


class Verbs:
    """Answers queries under `do/`."""

    def __init__(
        self,
        flight: FlightControl,
        link: Link,
        audit: Audit,
        interlock: Interlock,
        procedures: Mapping[str, Verb],
        paths: PathProbe | None = None,
        setpoint_root: str = "setpoint",
    ) -> None:
        self._paths = paths or PathProbe()
        self._setpoint_root = setpoint_root
        self._link = link
        self._flight = flight
        self._audit = audit
        self._interlock = interlock
        self._verbs: dict[str, Verb] = {
            "lease": self._lease,
            "release": self._release,
            "abort": self._abort,
            "rates": self._rates,
            "gains": self._gains,
            "preflight": self._preflight,
            "mark": self._mark,
            **procedures,
        }

    async def answer(self, suffix: str, payload: Payload) -> CommandResult:
        """Answer one query; every one is mirrored under `event/command`, whatever becomes of it."""

        async def work(fields: dict[str, Any]) -> CommandResult:
            name = suffix.removeprefix("do/")
            verb = self._verbs.get(name)
            if verb is None:
                near = difflib.get_close_matches(name, self._verbs, n=1, cutoff=0.4) or list(self._verbs)
                raise refuse(Token.UNKNOWN_VERB, name=name, near=" or ".join(near))
            return await verb(payload)

        return await answer_query(self._audit, suffix, payload, work)

    async def _lease(self, payload: Payload) -> CommandResult:
        """Answer `do/lease`; nobody takes one while a procedure needs the boards."""
        request = read_command(LeaseRequest, payload)
        if request.action == "probe":
            probe = LeaseProbe(echo=self._paths.new_echo())
            return CommandResult(status=Status.ACCEPTED, reply=dict(probe), reply_type=schema_name(LeaseProbe))
        if request.action == "take":
            with self._interlock.taking_lease(self._paths.delay(request.echo)):
                lease = await self._flight.lease(request)
        else:
            lease = await self._flight.lease(request)
        if lease is None:  # nobody holds it: there is nothing to describe
            return CommandResult(status=Status.ACCEPTED)
        if isinstance(lease, LeaseGrant):
            lease = lease.model_copy(update={"setpoint_root": self._setpoint_root})
        return CommandResult(status=Status.ACCEPTED, reply=dict(lease), reply_type=schema_name(type(lease)))

    async def _release(self, payload: Payload) -> CommandResult:
        """Answer `do/release`."""
        result = await self._flight.release(read_command(ReleaseRequest, payload))
        if result is None:
            raise refuse(Token.TIMEOUT, board="fc", name="release", detail=f"no end in {RELEASE_TIMEOUT:g} s")
        status = Status.ACCEPTED if result.status is ReleaseOutcome.CONFIRMED else Status.NOT_OBSERVABLE
        return CommandResult(status=status, reply=asdict(result), reply_type=schema_name(ReleaseReport))

    async def _abort(self, payload: Payload) -> CommandResult:
        """Answer `do/abort`."""
        self._flight.abort(read_command(AbortRequest, payload))
        return CommandResult(status=Status.ACCEPTED)

    async def _gains(self, payload: Payload) -> CommandResult:
        """Answer `do/gains`."""
        read_command(GainsRequest, payload)
        return CommandResult(status=Status.ACCEPTED, reply=dict(self._flight.gains()), reply_type=schema_name(Gains))

    async def _preflight(self, payload: Payload) -> CommandResult:
        """Answer `do/preflight`."""
        read_command(PreflightRequest, payload)
        report = (await self._flight.preflight()).model_dump(mode="json")
        return CommandResult(status=Status.ACCEPTED, reply=report, reply_type=schema_name(PreflightReport))

    async def _mark(self, payload: Payload) -> CommandResult:
        """Answer `do/mark`."""
        request = read_command(MarkRequest, payload)
        self._audit.mark(request.text, request.holder)
        return CommandResult(status=Status.ACCEPTED)

    async def _rates(self, payload: Payload) -> CommandResult:
        """Answer `do/rates`: change one stream, or just show all."""
        request = read_command(RatesRequest, payload)
        if request.stream is not None and request.interval is not None:
            self._link.set_rate(request.stream, request.interval)
        rates = Rates(intervals=self._link.rates())
        return CommandResult(status=Status.ACCEPTED, reply=dict(rates), reply_type=schema_name(Rates))
