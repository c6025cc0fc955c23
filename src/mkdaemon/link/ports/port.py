"""A port: bytes in, bytes out. Serial device, pseudo terminal, TCP connection or recording: the link cannot tell.

Addresses::

    /dev/serial/by-id/usb-FTDI_...     serial:/dev/ttyUSB0     a serial device
    pty:/dev/pts/7                                            a pseudo terminal, for example the simulator's
    tcp:host:port                                             a serial server (ser2net, a radio with Ethernet)
    replay:FILE?speed=20                                      a recorded session, with its timing, times 20
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol
from urllib.parse import parse_qsl

from mkdaemon.errors import ConfigError

DEFAULT_BAUD: Final = 57600
"""Line rate of every MikroKopter board [baud]; source: docs/protocol.md, "Physical layer"."""


class Port(Protocol):
    """An open port."""

    @property
    def name(self) -> str:
        """What a user calls it."""

    @property
    def backlog(self) -> int:
        """Bytes accepted by `write` that have not left yet, as far as the system can tell.

        A pseudo terminal tells nothing. Over TCP, bytes count that the other end has not acknowledged for a while.
        """

    @property
    def descriptor(self) -> int | None:
        """File descriptor of the open device or connection, for the guard; None where there is none."""

    @property
    def is_recording(self) -> bool:
        """Whether the other end only plays a recording: nothing is sent then."""

    async def read(self) -> bytes:
        """Return what arrived, as soon as there is something; nothing means that a recording has ended.

        Raises:
            LinkLostError: the port is gone.
        """

    def write(self, data: bytes) -> None:
        """Take bytes to send; never waits.

        Raises:
            LinkLostError: the port is gone.
        """

    def discard(self) -> None:
        """Throw away what was written and has not left; a TCP connection is ended for that.

        Raises:
            LinkLostError: the connection was ended.
        """

    async def drain(self) -> None:
        """Wait until everything written has left.

        Raises:
            LinkLostError: the port is gone.
        """

    async def close(self) -> None:
        """Let the device go; safe to call twice, never waits for a stuck device."""


@dataclass(frozen=True, slots=True)
class PortAddress:
    """A port's address, taken apart.

    Attributes:
        scheme: serial, pty, tcp or replay.
        target: device path, file path, or `host:port`.
        speed: how much faster than recorded a replay runs.
    """

    scheme: str
    target: str
    speed: float = 1.0


def parse_address(url: str) -> PortAddress:
    """Take a port's address apart.

    Raises:
        ConfigError: nothing could ever be opened under this address.
    """
    if not url:
        raise ConfigError('no port configured: set link.port, for example port = "/dev/serial/by-id/usb-FTDI_..."')
    scheme, found, rest = url.partition(":")
    if not found or url.startswith(("/", "./", "../")):
        scheme, rest = "serial", url
    if scheme in ("serial", "pty") and rest:
        if not rest.startswith(("/", "./", "../")):
            raise ConfigError(f'link.port "{url}" is not a path of a device: write it whole, for example /dev/{rest}')
        return PortAddress(scheme, rest)
    if scheme == "tcp":
        host, _, number = rest.rpartition(":")
        if host and number.isdecimal() and 0 < int(number) < 65536:
            return PortAddress("tcp", rest)
        raise ConfigError(f'link.port "{url}": a TCP port is written tcp:host:port, for example tcp:192.168.1.7:2000')
    if scheme == "replay" and rest:
        return _parse_replay(url, rest)
    raise ConfigError(
        f'link.port "{url}" is not a port: write a device path, serial:/dev/..., pty:/dev/pts/N, tcp:host:port or '
        "replay:FILE"
    )


def _parse_replay(url: str, rest: str) -> PortAddress:
    name, _, query = rest.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    text = options.pop("speed", "1")
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if options or not 0 < speed < float("inf"):
        raise ConfigError(f'link.port "{url}": a replay takes only speed, a number above 0, for example ?speed=20')
    return PortAddress("replay", name, speed)


async def open_port(url: str, *, baud: int = DEFAULT_BAUD) -> Port:
    """Open a port.

    Args:
        url: see the module's head.
        baud: line rate [baud]; without meaning for TCP and replay.

    Raises:
        ConfigError: such a port cannot exist.
        LinkLostError: it is not there now.
        LinkError: it is there, but may not or cannot be used now.
    """
    address = parse_address(url)
    match address.scheme:
        case "tcp":
            from mkdaemon.link.ports.tcpport import open_tcp

            return await open_tcp(address.target)
        case "replay":
            from mkdaemon.link.ports.replayport import open_replay

            return open_replay(Path(address.target), speed=address.speed)
        case scheme:
            from mkdaemon.link.ports.serialport import open_serial

            return await open_serial(Path(address.target), baud=baud, is_pty=scheme == "pty")
