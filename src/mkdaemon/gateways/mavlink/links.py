"""The links: UDP, TCP and serial; bytes in and out, each address a station.

A station that does not read delays no other: what its connection cannot take is dropped. No input raises an error.
"""

from __future__ import annotations

import asyncio
import os
import socket
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, Final

import structlog

from mkdaemon.errors import MkError
from mkdaemon.gateways.mavlink.addresses import Address, AddressKind
from mkdaemon.gateways.mavlink.dialect import Message
from mkdaemon.gateways.mavlink.framing import MAGIC, MOST_BYTES, Counts, Decoder, Encoder
from mkdaemon.gateways.mavlink.signing import Signing
from mkdaemon.gateways.mavlink.stations import SILENCE, Station

MOST_STATIONS: Final = 8
"""Stations of one link; a further one takes the place of the one that has been silent longest."""
_MOST_WAITING: Final = 65_536
"""Bytes that may wait for a slow station."""
_RETRY: Final = 1.0
"""Time between two attempts to open a serial line or to connect [s]."""

_LOG_AGAIN: Final = 10.0
"""The same thing about a link is logged again after this time [s]."""
_log: Final = structlog.get_logger("gateway.mavlink")

OnMessage = Callable[[Station, Message], None]
"""Takes a message and whose it is."""
Clock = Callable[[], float]


class Links:
    """All links of the gateway.

    Attributes:
        counts: what came, over all links.
        wall: the system clock [s].
    """

    def __init__(self, system: int, signing: Signing | None, on_message: OnMessage, now: Clock, wall: Clock) -> None:
        """Prepare the links.

        Args:
            system: number of the aircraft.
            signing: signs and checks, where there is a key.
            on_message: takes what comes.
            now: the monotonic clock [s].
            wall: the system clock [s].
        """
        self.counts = Counts()
        self._system, self._signing, self._on_message = system, signing, on_message
        self._now, self.wall = now, wall
        self._stations: dict[Station, Callable[[], None]] = {}
        self._logged: dict[tuple[Address, str], float] = {}
        self._closing: list[Callable[[], None]] = []
        self._link_ids = 0

    @property
    def stations(self) -> tuple[Station, ...]:
        """Those whose connection stands."""
        return tuple(self._stations)

    async def open(self, address: Address, tasks: asyncio.TaskGroup) -> None:
        """Open a link.

        Args:
            address: where.
            tasks: runs what is opened again when it is lost.

        Raises:
            MkError: it cannot be opened; says which and why.
        """
        loop = asyncio.get_running_loop()
        try:
            match address.kind:
                case AddressKind.UDP_OUT:
                    remote = (address.host, address.port)
                    made: Any = await loop.create_datagram_endpoint(
                        lambda: _Datagrams(self, address), remote_addr=remote
                    )
                    self._closing.append(made[0].close)
                case AddressKind.UDP_IN:
                    local = (address.host, address.port)
                    made = await loop.create_datagram_endpoint(lambda: _Datagrams(self, address), local_addr=local)
                    self._closing.append(made[0].close)
                case AddressKind.TCP_IN:
                    server = await loop.create_server(lambda: _Stream(self, address), address.host, address.port)
                    self._closing.append(server.close)
                case AddressKind.TCP_OUT | AddressKind.SERIAL:
                    tasks.create_task(self._keep(address), name=f"line {address.host}")
        except OSError as error:
            raise MkError(f"--link {address} cannot be opened: {error.strerror or error}") from error

    def close(self) -> None:
        """Close everything."""
        for close in self._closing:
            close()
        for station in self._stations:
            station.is_open = False
        self._stations.clear()

    def add(self, name: str, address: Address, put: Callable[[bytes], bool], end: Callable[[], None]) -> Station | None:
        """Meet a station; None where its link is full of stations that speak.

        Args:
            name: for people, behind the address.
            address: of the link.
            put: hands bytes over, from any thread; says whether they were taken.
            end: ends its connection, where another station takes its place.
        """
        if not self._has_room(address):
            self.log(address, "station refused: its link is full", stations=MOST_STATIONS, station=name)
            return None
        self._link_ids = (self._link_ids + 1) % 256
        encoder = Encoder(self._system, self._signing, self._link_ids)
        station = Station(f"{address} {name}".strip(), address.numbering, encoder, put, self.wall)
        station.received_at = self._now()
        self._stations[station] = end
        return station

    def _has_room(self, address: Address) -> bool:
        """Whether a link can take a further station; one that is silent is ended for it."""
        same = [one for one in self._stations if one.name.startswith(f"{address} ")]
        if len(same) < MOST_STATIONS:
            return True
        oldest = min(same, key=lambda one: one.received_at)
        if self._now() - oldest.received_at < SILENCE:
            return False
        end = self._stations[oldest]
        self.remove(oldest)
        end()
        return True

    def log(self, address: Address, event: str, **words: object) -> None:
        """Log what happens at a link, each thing seldom enough that a flood does not fill the log."""
        last = self._logged.get((address, event))
        if last is None or self._now() - last >= _LOG_AGAIN:
            self._logged[address, event] = self._now()
            _log.warning(event, link=str(address), **words)

    def remove(self, station: Station) -> None:
        """Forget a station."""
        station.is_open = False
        self._stations.pop(station, None)

    def received(self, station: Station, messages: Iterable[Message]) -> None:
        """Hand on what came."""
        for message in messages:
            self._on_message(station, message)

    def decoder(self) -> Decoder:
        """A decoder for one stream of bytes."""
        return Decoder(self.counts, self._signing)

    async def _keep(self, address: Address) -> None:
        """Open a serial line or a connection, again when it is lost."""
        loop = asyncio.get_running_loop()
        while True:
            with suppress(OSError, ValueError):  # SerialException is an OSError
                lost: asyncio.Future[None] = loop.create_future()
                made = lambda lost=lost: _Stream(self, address, lost)  # noqa: E731
                if address.kind is AddressKind.SERIAL:
                    import serial_asyncio

                    transport, _ = await serial_asyncio.create_serial_connection(
                        loop, made, address.host, baudrate=address.port
                    )
                else:
                    transport, _ = await loop.create_connection(made, address.host, address.port)
                try:
                    await lost
                finally:
                    transport.close()
            await asyncio.sleep(_RETRY)


class _Datagrams(asyncio.DatagramProtocol):
    """A UDP socket: each address that sends is a station; one that is connected has a single one."""

    def __init__(self, links: Links, address: Address) -> None:
        self._links, self._address = links, address
        self._decoder = links.decoder()
        self._stations: dict[Any, Station] = {}
        self._loop = asyncio.get_running_loop()
        self._socket: socket.socket | None = None

    def connection_made(self, transport: Any) -> None:
        # A transport is the loop's alone; a datagram is sent by whichever thread has it.
        self._socket = socket.socket(fileno=os.dup(transport.get_extra_info("socket").fileno()))
        self._socket.setblocking(False)
        if self._address.kind is AddressKind.UDP_OUT:
            self._add(None)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        messages = self._decoder.datagram(data, self._links.wall())
        if not messages:
            return
        key = None if self._address.kind is AddressKind.UDP_OUT else addr
        station = self._stations.get(key) or self._add(key)
        if station is not None:
            self._links.received(station, messages)

    def error_received(self, exc: Exception) -> None:
        """The port is closed, as the machine there reports at once: the program that used it has ended."""
        station = self._stations.get(None)
        if station is not None and isinstance(exc, ConnectionRefusedError):
            station.forget()

    def _add(self, key: Any) -> Station | None:
        name = "" if key is None else f"from {key[0]}:{key[1]}"
        station = self._links.add(name, self._address, lambda data: self._put(data, key), lambda: self._drop(key))
        if station is not None:
            self._stations[key] = station
        return station

    def _drop(self, key: Any) -> None:
        self._stations.pop(key, None)

    def _put(self, data: bytes, key: Any) -> bool:
        sender = self._socket  # the loop may close it meanwhile, which is an OSError
        if sender is None:
            return False
        try:
            if key is None:
                sender.send(data)
            else:
                sender.sendto(data, key)
        except BlockingIOError:
            return False
        except OSError as error:
            with suppress(RuntimeError):  # the loop may be closing
                self._loop.call_soon_threadsafe(self.error_received, error)
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class _Stream(asyncio.Protocol):
    """A TCP connection or a serial line."""

    def __init__(self, links: Links, address: Address, lost: asyncio.Future[None] | None = None) -> None:
        self._links, self._address, self._lost = links, address, lost
        self._decoder = links.decoder()
        self._station: Station | None = None
        self._loop = asyncio.get_running_loop()
        self._transport: Any = None
        self._posted: deque[bytes] = deque()
        self._has_started = False

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        peer = transport.get_extra_info("peername")
        name = f"from {peer[0]}:{peer[1]}" if peer and self._address.kind is AddressKind.TCP_IN else ""
        self._station = self._links.add(name, self._address, self._put, transport.close)
        if self._station is None:
            transport.close()

    def data_received(self, data: bytes) -> None:
        if self._station is None:
            return
        if self._address.kind is AddressKind.TCP_IN and not self._has_started and data[0] not in MAGIC:
            # A browser sends whatever a web page asks it to, but always behind a line of HTTP.
            self._links.log(
                self._address, "connection closed: it does not begin with MAVLink", station=self._station.name
            )
            self._transport.close()
            self._links.remove(self._station)
            self._station = None
            return
        self._has_started = True
        self._links.received(self._station, self._decoder.feed(data, self._links.wall()))

    def connection_lost(self, exc: Exception | None) -> None:
        if self._station is not None:
            self._links.remove(self._station)
        if self._lost is not None and not self._lost.done():
            self._lost.set_result(None)

    def _put(self, data: bytes) -> bool:
        transport = self._transport
        waiting = transport.get_write_buffer_size() + MOST_BYTES * len(self._posted)
        if transport.is_closing() or waiting > _MOST_WAITING:
            return False
        self._posted.append(data)
        with suppress(RuntimeError):  # the loop may be closing
            self._loop.call_soon_threadsafe(self._write)
        return True

    def _write(self) -> None:
        """Write on the loop, whose own a transport is, what was posted."""
        while self._posted:
            self._transport.write(self._posted.popleft())
