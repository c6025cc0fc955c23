"""A serial device or pseudo terminal, raw and locked against other programs.

Raw mode matters: with CR translated to NL every frame end is damaged (docs/protocol.md, "Physical layer").
"""

from __future__ import annotations

import asyncio
import errno
import fcntl
import grp
import os
import termios
from contextlib import suppress
from pathlib import Path
from typing import Final

import serial
import serial_asyncio

from mkdaemon.errors import ConfigError, LinkError, LinkLostError

_BY_ID: Final = Path("/dev/serial/by-id")
_LOST: Final = "the device was unplugged or its other end was closed"


class SerialPort(asyncio.Protocol):
    """An open serial device; see `Port`.

    The transport of pyserial-asyncio reads, watches for loss and keeps what the device does not take at once; bytes
    the device does take are written directly, because the transport would hold them until the next turn of the loop.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._transport: serial_asyncio.SerialTransport | None = None
        self._chunks: list[bytes] = []
        self._reader: asyncio.Future[None] | None = None
        self._loss: str | None = None
        self._gone = asyncio.get_running_loop().create_future()

    @property
    def name(self) -> str:
        """The device as the user named it."""
        return self._name

    @property
    def descriptor(self) -> int | None:
        """Of the open device; None while it is not."""
        if self._transport is None or self._loss is not None:
            return None
        number: int = self._transport.serial.fileno()
        return number

    @property
    def is_recording(self) -> bool:
        """False."""
        return False

    @property
    def backlog(self) -> int:
        """Bytes not yet taken by the device, the driver's queue included."""
        if self._transport is None or self._loss is not None:
            return 0
        waiting: int = self._transport.get_write_buffer_size()
        with suppress(OSError):
            waiting += self._transport.serial.out_waiting
        return waiting

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by the transport once."""
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Called by the transport with what arrived."""
        self._chunks.append(data)
        self._wake()

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by the transport once, at the end."""
        self._lose(_explain(exc))
        if not self._gone.done():
            self._gone.set_result(None)

    async def read(self) -> bytes:
        """Return what arrived, as soon as there is something; see `Port.read`."""
        while not self._chunks:
            if self._loss is not None:
                raise LinkLostError(f"{self._name}: {self._loss}")
            self._reader = asyncio.get_running_loop().create_future()
            try:
                await self._reader
            finally:
                self._reader = None
        if len(self._chunks) == 1:
            return self._chunks.pop()
        data = b"".join(self._chunks)
        self._chunks.clear()
        return data

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Port.write`."""
        if self._loss is not None or self._transport is None:
            raise LinkLostError(f"{self._name}: {self._loss or 'not open'}")
        taken = 0
        if not self._transport.get_write_buffer_size():
            try:
                taken = os.write(self._transport.serial.fileno(), data)
            except BlockingIOError:
                taken = 0
            except OSError as error:
                self._lose(_explain(error))
                raise LinkLostError(f"{self._name}: {self._loss}") from error
        if taken < len(data):
            self._transport.write(data[taken:])

    def discard(self) -> None:
        """Throw away what the device has not taken; see `Port.discard`."""
        if self._transport is not None and self._loss is None:
            self._transport.flush()
            with suppress(OSError, termios.error, serial.SerialException):
                self._transport.serial.reset_output_buffer()

    async def drain(self) -> None:
        """Wait until everything written has left; see `Port.drain`."""
        while self.backlog:  # noqa: ASYNC110 - no driver tells when its queue has become empty
            await asyncio.sleep(0.002)
        if self._loss is not None:
            raise LinkLostError(f"{self._name}: {self._loss}")

    async def close(self) -> None:
        """Let the device go; what it has not taken is thrown away, or a stuck device would hold us."""
        transport = self._transport
        if transport is None:
            return
        is_stuck = self.backlog > 0
        self._lose("closed")
        if not self._gone.done():
            transport.flush()
            # A device that takes nothing would hold the transport in tcdrain(), on the event loop. Only then: a pseudo
            # terminal throws away what its reader has not yet fetched, the frames of a release among it.
            if is_stuck:
                with suppress(OSError, termios.error, serial.SerialException, AttributeError):
                    transport.serial.reset_output_buffer()
            transport.abort()
            await self._gone
        self._transport = None

    def _lose(self, reason: str) -> None:
        if self._loss is None:
            self._loss = reason
        self._wake()

    def _wake(self) -> None:
        if self._reader is not None and not self._reader.done():
            self._reader.set_result(None)


def _explain(error: Exception | None) -> str:
    """Say in words why the device was lost."""
    if error is None:
        return "closed"
    number = _errno(error)
    if number in (None, errno.EIO, errno.ENXIO, errno.ENODEV, errno.EBADF):
        return _LOST
    if number == errno.ENOSPC:
        return "the device is full and takes no more bytes"
    return f"the device failed ({os.strerror(number)})"


def _errno(error: BaseException) -> int | None:
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and cause.errno:
            return cause.errno
        if isinstance(cause, termios.error):
            return int(cause.args[0])
        cause = cause.__cause__ or cause.__context__
    return None


async def open_serial(path: Path, *, baud: int, is_pty: bool = False) -> SerialPort:
    """Open a serial device for us alone.

    Raises:
        ConfigError: the line rate is impossible.
        LinkLostError: nothing is there now, or something else than a serial device.
        LinkError: it is there but in use, forbidden or broken.
    """
    device = _open_device(path, baud, is_pty=is_pty)
    port = SerialPort(str(path))
    serial_asyncio.SerialTransport(asyncio.get_running_loop(), port, device)
    await asyncio.sleep(0)  # the transport announces itself in the next turn of the loop
    return port


def _open_device(path: Path, baud: int, *, is_pty: bool) -> serial.Serial:
    """Open, set raw mode, lock."""
    try:
        device = serial.Serial(str(path), baud, exclusive=True, timeout=0, write_timeout=0)
    except (serial.SerialException, OSError, ValueError, termios.error) as error:
        raise _refusal(path, baud, error, is_pty=is_pty) from error
    # flock keeps out every program that asks; TIOCEXCL also those that do not. A pseudo terminal keeps the flag for as
    # long as its other end lives, so it would outlive a killed daemon.
    if not is_pty and not str(path.resolve()).startswith("/dev/pts/"):
        with suppress(OSError):
            fcntl.ioctl(device.fileno(), termios.TIOCEXCL)
    return device


def _refusal(path: Path, baud: int, error: Exception, *, is_pty: bool) -> LinkError | ConfigError:
    """One line: what, where, how to repair it."""
    number = _errno(error) if isinstance(error, OSError) else None
    if isinstance(error, ValueError):
        return ConfigError(f"{path} cannot run at {baud} baud: set link.baud to 57600")
    if not path.exists():
        return LinkLostError(f"no serial port {path}: {_what_is_there(is_pty=is_pty)}")
    if number in (errno.EACCES, errno.EPERM):
        group = _group(path)
        return LinkError(f"no permission for {path}: it belongs to group {group}; run: sudo usermod -aG {group} $USER")
    if number in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error):
        return LinkError(f"{path} is in use by {_owner(path)}: end that program, or give it another port")
    if number == errno.ENOTTY or not path.is_char_device():
        # The name may be a plain file: a program wrote to it while the cable was unplugged.
        return LinkLostError(
            f"{path} is not a serial device: name one in link.port, or remove it so that the device can take its name; "
            "mkdaemon doctor lists what is plugged in"
        )
    if number in (errno.EIO, errno.ENXIO, errno.ENODEV):
        return LinkLostError(f"{path} is there but its other end is not: {_what_is_there(is_pty=is_pty)}")
    return LinkError(f"{path} cannot be opened: {error}")


def _what_is_there(*, is_pty: bool) -> str:
    """Name the ports a user could mean."""
    if is_pty:
        return "start the simulator (mkdaemon sim) and use the port it prints"
    found = sorted(str(entry) for entry in _BY_ID.iterdir()) if _BY_ID.is_dir() else []
    if not found:
        return "plug the adapter in; no serial adapter is connected now"
    return f"plug it in, or set link.port to {' or '.join(found)}"


def _group(path: Path) -> str:
    number = path.stat().st_gid
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def _owner(path: Path) -> str:
    """Name the program that holds a device, as far as /proc lets us see."""
    wanted = path.resolve()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal() or int(entry.name) == os.getpid():
            continue
        with suppress(OSError):
            if any(handle.resolve() == wanted for handle in (entry / "fd").iterdir()):
                name = (entry / "comm").read_text(encoding="utf-8", errors="replace").strip()
                return f"{name} (process {entry.name})"
    return "another program"
