"""The way in that needs no Zenoh: a Unix socket that releases, however busy the bus is.

Thousands of silent TCP connections keep every new client off the bus; a program on this machine that may open the
socket can release all the same. See `mkdaemon.bus.localsocket` for what is said over it.
"""

from __future__ import annotations

import asyncio
import grp
import os
import selectors
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgpack

from mkdaemon.bus.localsocket import REQUEST_BYTES, VERBS
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.refusals import Token, refuse

REQUEST_TIME: Final = 1.0
"""A connection that has asked for nothing after this long is closed [s]."""
CONNECTIONS: Final = 64
"""Silent connections at a time."""
WORKED_ON: Final = 16
"""Requests of one verb that are worked on at a time."""
BACKLOG: Final = 1024
"""Connections that wait in the kernel; with 16, a flood of connections kept a release out."""
AT_ONCE: Final = 64
"""Connections taken before those that are open are looked at again."""
READ_BYTES: Final = 1 << 16
"""Read at a time: what is left unread makes the kernel end a connection with an error [bytes]."""
RETRY: Final = 0.02
"""Pause where no connection can be taken [s]."""
CLOSING: Final = 1.0
"""Longest wait for the thread at the end [s]."""

Answer = Callable[[str, bytes], Awaitable[CommandResult]]
"""Answers `do/<verb>` with a payload, as on the bus."""


class LocalSocket:
    """Answers requests over a Unix socket: its thread receives them, the loop works on them."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer

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
        reception = SocketReception(_listen(path, group), asyncio.get_running_loop(), self._answer)
        reception.start()
        try:
            yield
        finally:
            reception.close()
            _remove(path)


@dataclass(slots=True, eq=False)
class _Guest:
    """A connection that has asked for nothing yet.

    Attributes:
        connection: with it.
        process: at its other end.
        until: when it is closed [s; monotonic].
        request: bytes received.
    """

    connection: socket.socket
    process: int
    until: float
    request: bytes = b""


class SocketReception(threading.Thread):
    """Takes connections and reads what they ask for, so that a storm of them costs the loop nothing.

    It accepts all waiting connections and reads their requests at once. If more than `CONNECTIONS` are silent, it
    closes the oldest one of the process that has most. So a request is read before a flood can displace it.
    """

    def __init__(self, listener: socket.socket, loop: asyncio.AbstractEventLoop, answer: Answer) -> None:
        """Prepare.

        Args:
            listener: bound, and does not block; closed at the end.
            loop: where `answer` runs.
            answer: works on a request.
        """
        super().__init__(name="local socket", daemon=True)
        self._listener, self._loop, self._answer = listener, loop, answer
        self._silent: dict[_Guest, None] = {}
        self._rooms = {verb: threading.Semaphore(WORKED_ON) for verb in VERBS}
        self._is_over = False
        self._waker, self._woken = socket.socketpair()

    def close(self) -> None:
        """End it; from any thread. Requests that were read are still answered if the loop gets to them."""
        self._waker.send(b".")  # first: a thread that sees that it is over closes the other end
        self._is_over = True
        self.join(CLOSING)

    def run(self) -> None:
        """Take connections until the end."""
        with self._listener, self._waker, self._woken, selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while not self._is_over:
                ready = selector.select(self._patience())
                began = time.monotonic()
                for key, _ in ready:
                    if key.fileobj is self._listener:
                        self._accept(selector)
                    elif isinstance(key.data, _Guest) and key.data in self._silent:
                        self._read(key.data, selector)
                for guest in [one for one in self._silent if one.until <= began]:
                    self._forget(guest, selector).close()
                # Half the time at most: the loop needs the interpreter too.
                time.sleep(time.monotonic() - began)
            for guest in list(self._silent):
                self._forget(guest, selector).close()

    def _patience(self) -> float | None:
        oldest = next(iter(self._silent), None)
        return None if oldest is None else max(oldest.until - time.monotonic(), 0.0)

    def _accept(self, selector: selectors.BaseSelector) -> None:
        for _ in range(AT_ONCE):
            try:
                connection, _ = self._listener.accept()
            except BlockingIOError:
                return
            except OSError:  # no descriptor is left
                self._end_one(selector)
                time.sleep(RETRY)
                return
            connection.setblocking(False)
            guest = _Guest(connection, _process_of(connection), time.monotonic() + REQUEST_TIME)
            self._silent[guest] = None
            selector.register(connection, selectors.EVENT_READ, guest)
            self._read(guest, selector)
            if len(self._silent) > CONNECTIONS:
                self._end_one(selector)

    def _end_one(self, selector: selectors.BaseSelector) -> None:
        """End the oldest silent connection of the process that has most."""
        counts = Counter(guest.process for guest in self._silent)
        for guest in self._silent:
            if counts[guest.process] == max(counts.values()):
                self._forget(guest, selector).close()
                return

    def _forget(self, guest: _Guest, selector: selectors.BaseSelector) -> socket.socket:
        del self._silent[guest]
        selector.unregister(guest.connection)
        return guest.connection

    def _read(self, guest: _Guest, selector: selectors.BaseSelector) -> None:
        """Read what has come; a whole line, or the end, is the request."""
        try:
            data = guest.connection.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data, guest.request = b"", b""
        guest.request += data
        line, newline, _ = guest.request.partition(b"\n")
        if data and not newline and len(guest.request) <= REQUEST_BYTES:
            return
        connection = self._forget(guest, selector)
        verb, _, text = line.decode(errors="replace").strip().partition(" ")
        if not verb or len(line) >= REQUEST_BYTES:
            connection.close()
        elif verb not in VERBS:
            _reply(connection, refused(refuse(Token.UNKNOWN_VERB, name=verb, near=" or ".join(VERBS))))
        elif not self._rooms[verb].acquire(blocking=False):
            _reply(connection, refused(refuse(Token.BUSY, detail=f"{WORKED_ON} of these are being worked on")))
        else:
            self._ask(connection, verb, text)

    def _ask(self, connection: socket.socket, verb: str, text: str) -> None:
        """Have a request worked on by the loop, and answered there."""
        fields = {"reason": text} if verb == "release" and text else {}

        async def work() -> None:
            try:
                _reply(connection, await self._answer(f"do/{verb}", msgpack.packb(fields)))
            finally:
                connection.close()
                self._rooms[verb].release()

        with suppress(RuntimeError):  # the loop has ended
            asyncio.run_coroutine_threadsafe(work(), self._loop)


def _reply(connection: socket.socket, result: CommandResult) -> None:
    """Answer and close; an answer is shorter than the kernel's buffer for a client that does not read."""
    with connection, suppress(OSError):
        connection.send(result.model_dump_json().encode() + b"\n")


def _process_of(connection: socket.socket) -> int:
    """Process at the other end of a connection; 0 where the system does not say."""
    if not hasattr(socket, "SO_PEERCRED"):
        return 0
    number: int = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0]
    return number


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
        listener.listen(BACKLOG)
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
