"""The way to a daemon on this machine that needs no Zenoh; see `mkdaemon.bus.localsocket`."""

from __future__ import annotations

import asyncio
import errno
import json
import os
from pathlib import Path
from typing import Final

from mkdaemon.bus.localsocket import SERVICE_FOLDER, is_here, socket_folders, socket_name
from mkdaemon.client.answers import Answer
from mkdaemon.errors import MkError

ANSWER_TIME: Final = 8.0
"""Longest wait for an answer [s]; a release has an end within 5 s."""
RETRY: Final = 0.02
"""Pause before it is asked again [s]; asking twice for the same does no harm."""
_SHUT_OUT: Final = frozenset({errno.EAGAIN, errno.ENOTCONN, errno.ECONNRESET, errno.EPIPE})
"""What a connection meets for which the kernel or the daemon had no room."""


def find_socket(vehicle: str, endpoint: str) -> Path | None:
    """The socket of the daemon that listens at an endpoint; None where it is on another machine or has none."""
    if not is_here(endpoint):
        return None
    folders = (*socket_folders(), SERVICE_FOLDER / vehicle)  # the last is that of one service of many
    paths = (folder / socket_name(vehicle, endpoint) for folder in folders if _is_trusted(folder))
    return next((path for path in paths if path.exists()), None)


def _is_trusted(folder: Path) -> bool:
    """Whether no other ordinary user could have put a socket there; systemd makes its own folder."""
    try:
        return SERVICE_FOLDER in (folder, folder.parent) or folder.stat().st_uid in {os.getuid(), 0}
    except OSError:
        return False


async def ask_locally(path: Path, verb: str, text: str = "") -> Answer:
    """Ask a daemon over its socket.

    Args:
        path: the socket.
        verb: `release` or `cancel`.
        text: why, for `release`.

    Raises:
        MkError: no daemon answers there, or this user has no permission.
    """
    request = f"{verb} {' '.join(text.split())[:200]}\n".encode()
    try:
        async with asyncio.timeout(ANSWER_TIME):
            while not (line := await _ask_once(path, request)):  # noqa: ASYNC110 - no event says when there is room
                await asyncio.sleep(RETRY)
        return Answer.from_fields(json.loads(line))
    except (OSError, TimeoutError, ValueError) as error:
        raise MkError(f"{path}: {getattr(error, 'strerror', None) or 'no answer'}") from error


async def _ask_once(path: Path, request: bytes) -> bytes:
    """Ask once; empty where a storm of connections shut this one out.

    Raises:
        OSError: no daemon listens there, or this user has no permission.
    """
    try:
        reader, writer = await asyncio.open_unix_connection(str(path))
        try:
            writer.write(request)
            return await reader.readline()
        finally:
            writer.close()
    except OSError as error:
        if error.errno in _SHUT_OUT:
            return b""
        raise
