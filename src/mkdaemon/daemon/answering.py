"""Every query gets an answer, and every answer is also published."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import structlog

from mkdaemon.bus.codec import Payload, decode_map
from mkdaemon.daemon.audit import Audit
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.refusals import Token, refuse

_log = structlog.get_logger(__name__)


async def answer_query(
    audit: Audit,
    suffix: str,
    payload: Payload,
    work: Callable[[dict[str, Any]], Awaitable[CommandResult]],
) -> CommandResult:
    """Answer a query; it is mirrored under `event/command`, whatever becomes of it.

    Args:
        audit: hears of it.
        suffix: what was asked.
        payload: with what.
        work: does it with the given fields; may refuse.
    """
    fields: dict[str, Any] = {}
    try:
        fields = decode_map(payload)
        result = await work(fields)
    except CommandRejectedError as error:
        result = refused(error)
    except Exception as error:  # noqa: BLE001
        # One client's strange request must not end the flight of another: answer, log, go on.
        _log.exception("query failed", key=suffix)
        result = refused(refuse(Token.INTERNAL, detail=f"{type(error).__name__}: {error}"))
    audit.command(suffix, fields, result)
    return result
