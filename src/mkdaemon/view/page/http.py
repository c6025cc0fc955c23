"""As much HTTP as one page on this machine needs: a request read with limits, an answer written, events streamed.

The page is served from 127.0.0.1 only. A foreign web page in the same browser can reach that address too. So a
request must name it as its host, and a command carries a token that only our page has.

Not aiohttp: of it one would use a request's head, a body of known length and a stream, which are seventy lines here; it
and what it needs would be seven more packages of every installation, where `mkctl view` now needs none.
"""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import parse_qs, unquote, urlsplit

LONGEST_HEAD: Final = 16_384
"""Of a request [bytes]."""
LONGEST_BODY: Final = 4096
"""Of what a page asks for [bytes]."""
PATIENCE: Final = 10.0
"""Longest wait for a request [s]."""
_SECURITY: Final = (
    "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n"
    "X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCache-Control: no-store\r\n"
)
"""Nothing from anywhere else, whatever the page says."""


@dataclass(frozen=True, slots=True)
class HttpRequest:
    """What a browser asks for.

    Attributes:
        method: `GET` or `POST`.
        path: without what follows the question mark.
        query: what follows it; the first of each name.
        headers: by name in lower case.
        fields: of the JSON body; empty for none.
    """

    method: str
    path: str
    query: dict[str, str]
    headers: dict[str, str]
    fields: dict[str, Any]


class BadRequestError(Exception):
    """What was asked cannot be answered.

    Attributes:
        status: to answer with.
    """

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        """Say why."""
        super().__init__(reason)
        self.status = status


async def read_request(reader: asyncio.StreamReader) -> HttpRequest | None:
    """Read one; None where the browser closed the connection.

    Raises:
        BadRequestError: it is none, or too long, or took too long.
    """
    try:
        async with asyncio.timeout(PATIENCE):
            head = await reader.readuntil(b"\r\n\r\n")
            request = _parse(head.decode("latin-1"))
            length = int(request.headers.get("content-length", "0"))
            if not 0 <= length <= LONGEST_BODY:
                raise BadRequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too long")
            body = await reader.readexactly(length)
    except asyncio.IncompleteReadError:
        return None
    except asyncio.LimitOverrunError:
        raise BadRequestError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "too long") from None
    except TimeoutError:
        raise BadRequestError(HTTPStatus.REQUEST_TIMEOUT, "too slow") from None
    except ValueError:
        raise BadRequestError(HTTPStatus.BAD_REQUEST, "no HTTP") from None
    return HttpRequest(request.method, request.path, request.query, request.headers, _fields(body))


def _parse(head: str) -> HttpRequest:
    first, *lines = head.split("\r\n")
    method, target, _ = first.split(" ")
    parts = urlsplit(target)
    query = {name: values[0] for name, values in parse_qs(parts.query).items()}
    pairs = (line.partition(":") for line in lines if line)
    return HttpRequest(
        method, unquote(parts.path), query, {name.lower(): value.strip() for name, _, value in pairs}, {}
    )


def _fields(body: bytes) -> dict[str, Any]:
    try:
        fields = json.loads(body) if body else {}
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise BadRequestError(HTTPStatus.BAD_REQUEST, "no JSON object")
    return fields


def answer(body: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> bytes:
    """A whole answer.

    Args:
        body: of it.
        kind: its MIME type.
        status: 200 unless given.
    """
    head = (
        f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
        f"Connection: close\r\n{_SECURITY}\r\n"
    )
    return head.encode() + body


def stream_head() -> bytes:
    """The beginning of an answer that never ends: events, as `EventSource` reads them."""
    return f"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nConnection: close\r\n{_SECURITY}\r\n".encode()


def event(value: Any) -> bytes:
    """One event."""
    return b"data: " + json.dumps(value, separators=(",", ":"), allow_nan=False).encode() + b"\n\n"
