"""The way in that needs no Zenoh: a Unix socket that releases, however busy the bus is.

Thousands of silent TCP connections keep every new client off the bus; whoever is on this machine and may open the
socket can release all the same. See `mkdaemon.bus.localsocket` for what is said over it.
"""

from __future__ import annotations

import asyncio
import grp
import os
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

import msgpack

from mkdaemon.bus.localsocket import REQUEST_BYTES, VERBS
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.refusals import Token, refuse

REQUEST_TIME: Final = 1.0
"""A connection that has asked for nothing after this long is closed [s]."""
CONNECTIONS: Final = 16
"""Connections at a time; a further one ends the oldest."""

Answer = Callable[[str, bytes], Awaitable[CommandResult]]
"""Answers `do/<verb>` with a payload, as on the bus."""


class LocalSocket:
    """Answers requests over a Unix socket, on the loop."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._open: dict[asyncio.Task[None], None] = {}

    @asynccontextmanager
    async def serve(self, path: Path, group: str | None = None) -> AsyncIterator[None]:
        """Listen while the context lasts.

        Args:
            path: of the socket; its folder is made where it is missing, for this user alone.
            group: whose members may connect too; None for the user alone.

        Raises:
            ConfigError: there is no such group, or this user is not in it.
            MkError: another daemon listens there, or the folder cannot be used.
        """
        server = await asyncio.start_unix_server(self._accept, sock=_listen(path, group), limit=REQUEST_BYTES)
        try:
            yield
        finally:
            server.close()
            for task in self._open:
                task.cancel()
            _remove(path)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        if len(self._open) >= CONNECTIONS:
            next(iter(self._open)).cancel()
        self._open[task] = None
        try:
            await self._converse(reader, writer)
        except (OSError, TimeoutError, ValueError, asyncio.CancelledError):
            pass  # it asked nothing, too much, or has gone
        finally:
            del self._open[task]
            writer.close()

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with asyncio.timeout(REQUEST_TIME):
            line = await reader.readline()
        verb, _, text = line.decode(errors="replace").strip().partition(" ")
        if not verb:
            return
        writer.write((await self._result(verb, text)).model_dump_json().encode() + b"\n")
        async with asyncio.timeout(REQUEST_TIME):
            await writer.drain()

    async def _result(self, verb: str, text: str) -> CommandResult:
        if verb not in VERBS:
            return refused(refuse(Token.UNKNOWN_VERB, name=verb, near=" or ".join(VERBS)))
        fields = {"reason": text} if verb == "release" and text else {}
        return await self._answer(f"do/{verb}", msgpack.packb(fields))


def check_group(name: str) -> int:
    """Return the number of a group that this user may share the socket with.

    Raises:
        ConfigError: there is no such group, or this user is not in it.
    """
    try:
        number = grp.getgrnam(name).gr_gid
    except KeyError as error:
        msg = f"bus.local_group: there is no group {name!r} on this machine"
        raise ConfigError(msg) from error
    if os.geteuid() != 0 and number not in {os.getegid(), *os.getgroups()}:
        raise ConfigError(_not_in(name))
    return number


def _not_in(group: str) -> str:
    return f"bus.local_group: the daemon's user is not in group {group!r}"


def _listen(path: Path, group: str | None) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if path.parent.stat().st_uid not in {os.getuid(), 0}:
            msg = f"{path.parent}: belongs to another user, so no local socket there"
            raise MkError(msg)
        _remove_stale(path)
        umask = os.umask(0o177)
        try:
            listener.bind(str(path))
        finally:
            os.umask(umask)
        if group is not None:
            _share(path, group)
        listener.listen(CONNECTIONS)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        msg = f"{path}: no local socket: {error.strerror or error}"
        raise MkError(msg) from error
    except MkError:
        listener.close()
        raise
    return listener


def _share(path: Path, group: str) -> None:
    try:
        number = check_group(group)
        os.chown(path, -1, number)
        path.chmod(0o660)
        if path.parent.stat().st_uid == os.getuid():
            os.chown(path.parent, -1, number)
            path.parent.chmod(0o750)
    except PermissionError as error:
        _remove(path)
        raise ConfigError(_not_in(group)) from error
    except ConfigError:
        _remove(path)
        raise


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


def _remove_stale(path: Path) -> None:
    """Remove the socket of a daemon that was killed.

    Raises:
        MkError: its daemon lives.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(0.2)
        try:
            probe.connect(str(path))
        except FileNotFoundError:
            return
        except ConnectionRefusedError:
            path.unlink()
            return
        except TimeoutError:
            pass
    msg = f"{path}: another daemon listens there"
    raise MkError(msg)
