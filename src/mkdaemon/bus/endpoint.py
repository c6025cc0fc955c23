"""Loopback endpoints for programs that start others: demo, benchmarks, tests."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def reserved_endpoint() -> Iterator[str]:
    """A TCP endpoint on loopback that no other caller gets while the context lasts.

    It stays bound, with SO_REUSEADDR and without listening: the system hands it to no other program by chance, and
    the caller can listen there, because Zenoh and asyncio set SO_REUSEADDR as well. Until then a connection is refused
    at once. (socket(7), ip(7))
    """
    with socket.socket() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(("127.0.0.1", 0))
        yield f"tcp/127.0.0.1:{holder.getsockname()[1]}"
