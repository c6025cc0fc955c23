"""What tests of the bus share: a loopback endpoint of their own and a plain client."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import msgpack
import zenoh

from mkdaemon.bus.session import session_config


def free_endpoint() -> str:
    """A TCP endpoint on loopback nobody listens on at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def client(endpoint: str) -> Iterator[zenoh.Session]:
    """A client session as any program would open it."""
    session = zenoh.open(session_config("client", connect=[endpoint]))
    try:
        yield session
    finally:
        session.close()


def ask(session: zenoh.Session, key: str, payload: dict | bytes | None = None, timeout: float = 5.0) -> list:
    """Every reply to a query as (key, map or bytes, encoding)."""
    body = msgpack.packb(payload) if isinstance(payload, dict) else payload
    replies = []
    for reply in session.get(key, payload=body, timeout=timeout):
        raw = reply.ok.payload.to_bytes()
        encoding = str(reply.ok.encoding)
        value = msgpack.unpackb(raw) if "msgpack" in encoding else raw
        replies.append((str(reply.ok.key_expr), value, encoding))
    return replies
