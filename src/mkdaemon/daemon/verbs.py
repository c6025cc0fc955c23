"""Requests to the daemon itself: `do/<verb>`."""

from __future__ import annotations

import difflib
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import asdict
from typing import Any, Final

from pydantic import BaseModel

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
    AcceptAircraftRequest,
    CommandResult,
    GainsRequest,
    LeaseRequest,
    PreflightRequest,
    Rates,
    RatesRequest,
    ReleaseRequest,
)
from mkdaemon.telemetry.control import HolderGrant, LeaseGrant, LeaseProbe, ReleaseOutcome, ReleaseReport
from mkdaemon.telemetry.path import PathUploadRequest
from mkdaemon.telemetry.record import MarkRequest
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.status import Status
from mkdaemon.telemetry.verbs import VERBS

Procedure = Callable[[Payload], Awaitable[CommandResult]]
Handler = Callable[[Any], Awaitable[CommandResult]]
"""Answers a request of the kind that `telemetry/verbs.py` has for its verb."""

_VERBS: Final = {verb.name: verb for verb in VERBS}


class Verbs:
    """Answers queries under `do/`."""

    def __init__(
        self,
        flight: FlightControl,
        link: Link,
        audit: Audit,
        interlock: Interlock,
        procedures: Mapping[str, Procedure],
        paths: PathProbe | None = None,
        setpoint_root: str = "setpoint",
    ) -> None:
        self._paths = paths or PathProbe()
        self._setpoint_root = setpoint_root
        self._link = link
        self._flight = flight
        self._audit = audit
        self._interlock = interlock
        self._procedures = procedures
        self._handlers: dict[str, Handler] = {
            "lease": self._lease,
            "release": self._release,
            "abort": self._abort,
            "rates": self._rates,
            "gains": self._gains,
            "preflight": self._preflight,
            "accept_aircraft": self._accept_aircraft,
            "path_upload": self._path_upload,
            "mark": self._mark,
        }

    async def answer(self, suffix: str, payload: Payload) -> CommandResult:
        """Answer one query; every one is mirrored under `event/command`, whatever becomes of it."""

        async def work(fields: dict[str, Any]) -> CommandResult:
            name = suffix.removeprefix("do/")
            verb = _VERBS.get(name)
            if verb is None:
                near = difflib.get_close_matches(name, _VERBS, n=1, cutoff=0.4) or list(_VERBS)
                raise refuse(Token.UNKNOWN_VERB, name=name, near=" or ".join(near))
            procedure = self._procedures.get(name)
            if procedure is not None:
                return await procedure(payload)
            return await self._handlers[name](read_command(verb.request, payload))

        return await answer_query(self._audit, suffix, payload, work)

    async def _lease(self, request: LeaseRequest) -> CommandResult:
        """Answer `do/lease`; it cannot be taken while a procedure needs the boards."""
        if request.action == "probe":
            return _accepted(LeaseProbe(echo=self._paths.new_echo()))
        if request.action == "take":
            with self._interlock.taking_lease(self._paths.delay(request.echo)):
                lease = await self._flight.lease(request)
        else:
            lease = await self._flight.lease(request)
        if isinstance(lease, LeaseGrant):
            lease = HolderGrant(**{**dict(lease), "setpoint_root": self._setpoint_root, "takes_stamps": True})
        # Without a holder there is nothing to describe.
        return CommandResult(status=Status.ACCEPTED) if lease is None else _accepted(lease)

    async def _release(self, request: ReleaseRequest) -> CommandResult:
        """Answer `do/release`."""
        result = await self._flight.release(request)
        if result is None:
            raise refuse(Token.TIMEOUT, board="fc", name="release", detail=f"no end in {RELEASE_TIMEOUT:g} s")
        status = Status.ACCEPTED if result.status is ReleaseOutcome.CONFIRMED else Status.NOT_OBSERVABLE
        return CommandResult(status=status, reply=asdict(result), reply_type=schema_name(ReleaseReport))

    async def _abort(self, request: AbortRequest) -> CommandResult:
        """Answer `do/abort`."""
        self._flight.abort(request)
        return CommandResult(status=Status.ACCEPTED)

    async def _gains(self, request: GainsRequest) -> CommandResult:
        """Answer `do/gains`."""
        return _accepted(self._flight.gains())

    async def _preflight(self, request: PreflightRequest) -> CommandResult:
        """Answer `do/preflight`."""
        return _accepted(await self._flight.preflight())

    async def _accept_aircraft(self, request: AcceptAircraftRequest) -> CommandResult:
        """Answer `do/accept_aircraft`."""
        self._link.accept_aircraft()
        return CommandResult(status=Status.ACCEPTED)

    async def _path_upload(self, request: PathUploadRequest) -> CommandResult:
        """Answer `do/path_upload`."""
        return _accepted(self._flight.store_path(request))

    async def _mark(self, request: MarkRequest) -> CommandResult:
        """Answer `do/mark`."""
        self._audit.mark(request.text, request.holder)
        return CommandResult(status=Status.ACCEPTED)

    async def _rates(self, request: RatesRequest) -> CommandResult:
        """Answer `do/rates`: change one stream, or just show all."""
        if request.stream is not None and request.interval is not None:
            self._link.set_rate(request.stream, request.interval)
        return _accepted(Rates(intervals=self._link.rates()))


def _accepted(reply: BaseModel) -> CommandResult:
    """Accept with an answer."""
    return CommandResult(
        status=Status.ACCEPTED, reply=reply.model_dump(mode="json"), reply_type=schema_name(type(reply))
    )
