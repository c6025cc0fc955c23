"""What the daemon itself can be asked for: `do/<verb>`."""

from __future__ import annotations

import difflib
from collections.abc import Awaitable, Callable
from typing import Any

from mkdaemon.bus.codec import decode_map, read_command, schema_name
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.flight import FlightControl
from mkdaemon.errors import CommandRejectedError, LinkLostError, RequestTimeoutError
from mkdaemon.link.labels import LabelCache, read_labels
from mkdaemon.link.link import Link
from mkdaemon.link.procedures import SilentObserver
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.command import CommandResult, Labels, LabelsRequest, RateRequest, Rates, refused
from mkdaemon.telemetry.refusals import Status, Token, refuse

Verb = Callable[[bytes], Awaitable[CommandResult]]


class Verbs:
    """Answers queries under `do/`."""

    def __init__(self, flight: FlightControl, link: Link, audit: Audit, label_cache: LabelCache) -> None:
        self._link = link
        self._label_cache = label_cache
        self._audit = audit
        self._verbs: dict[str, Verb] = {
            "lease": flight.lease,
            "release": flight.release,
            "rate": self._rate,
            "labels": self._labels,
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

    async def _rate(self, raw: bytes) -> CommandResult:
        """Answer `do/rate`: change one stream, or just show all."""
        request = read_command(RateRequest, raw)
        if request.stream is not None and request.interval is not None:
            self._link.set_rate(request.stream, request.interval)
        rates = Rates(intervals=self._link.rates())
        return CommandResult(status=Status.ACCEPTED, reply=dict(rates), reply_type=schema_name(Rates))

    async def _labels(self, raw: bytes) -> CommandResult:
        """Answer `do/labels` from what is kept for this firmware, or from the board itself."""
        request = read_command(LabelsRequest, raw)
        try:
            names = await read_labels(self._link, Board[request.board.upper()], self._label_cache, SilentObserver())
        except RequestTimeoutError as error:
            raise refuse(Token.TIMEOUT, board=request.board, name="label", detail=str(error)) from error
        except LinkLostError as error:
            condition = self._link.health().state.condition.value
            raise refuse(Token.LINK_DOWN, state=condition, detail=str(error)) from error
        labels = Labels(board=request.board, names=names)
        return CommandResult(status=Status.ACCEPTED, reply=dict(labels), reply_type=schema_name(Labels))
