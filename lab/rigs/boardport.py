"""A port with simulated boards at its other end and faults by name, in the time of the running loop.

The boards are the simulator's state machines in exact time; this port carries bytes to and from them, and spoils them
on request. With `VirtualLoop` a session is exact, seeded and faster than real time.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from enum import StrEnum
from typing import Final

from mkdaemon.errors import LinkError, LinkLostError
from mkdaemon.link.ports.port import Port
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mksim.simulation import Simulation

TICK_TIME: Final = 1e-3
"""How often bytes are carried, where it matters when they arrive [s]."""
ADAPTER_TIME: Final = 4e-3
"""How often bytes are carried, as by a USB adapter that gathers what it hands on [s]; a quarter of the work."""


class LineFault(StrEnum):
    """What can be wrong with a line, by name."""

    NONE = "none"
    BYTE_LOSS = "byte_loss"
    """Each byte vanishes with the given probability, both ways."""
    BIT_FLIPS = "bit_flips"
    """Each byte has one bit turned with the given probability, both ways."""
    ONE_BYTE_AT_A_TIME = "one_byte_at_a_time"
    """Every read gives a single byte."""
    STUCK_WRITER = "stuck_writer"
    """The port accepts bytes and never sends them."""
    DEVICE_FULL = "device_full"
    """The port fails with "no space left on device" when written to."""
    SILENCE = "silence"
    """Nothing comes from the board, which hears us."""
    ONE_WAY = "one_way"
    """The board talks, but hears nothing."""
    ECHO_ONLY = "echo_only"
    """Only link tests are answered."""
    GARBAGE = "garbage"
    """Random bytes come instead of the board's."""
    TEXT_FLOOD = "text_flood"
    """Boot banners come without end."""
    REBOOT = "reboot"
    """Every board is reset: boot text, seconds of silence, every subscription forgotten, the first frame kept."""
    UNPLUGGED = "unplugged"
    """The device disappears while it is read."""
    GONE_DURING_WRITE = "gone_during_write"
    """The device disappears while it is written."""


class Socket:
    """Where a cable is plugged in: opens ports to the same boards again and again, or says that nothing is there.

    Attributes:
        right_baud: line rate at which bytes can be understood.
        wire: everything written, with its time [s].
        slept: how long the host has been suspended; the boards went on [s].
        tick: how often bytes are carried [s].
    """

    def __init__(
        self,
        make: Callable[[], Simulation],
        *,
        seed: int,
        right_baud: int = 57600,
        tick: float = TICK_TIME,
        age: float = 0.0,
    ) -> None:
        """Plug an aircraft in; `make` powers a new one up, this one `age` ago [s]."""
        self.rng = random.Random(f"{seed} line")
        self.tick = tick
        self.is_present = True
        self.right_baud = right_baud
        self.openings = 0
        self.slept = 0.0
        self.port: BoardPort | None = None
        self.wire: list[tuple[float, bytes]] = []
        self._make = make
        self.aircraft = make()
        self._started = self._time() - age

    def _time(self) -> float:
        """Time that passes for everybody but a suspended host [s]."""
        return asyncio.get_running_loop().time() + self.slept

    def now(self) -> float:
        """Time of the boards [s]."""
        return self._time() - self._started

    def power_cycle(self) -> None:
        """Put a new aircraft in the place of the old one."""
        self._started = self._time()
        self.aircraft = self._make()

    def replace(self, make: Callable[[], Simulation]) -> None:
        """Put another aircraft in the place of this one."""
        self._make = make
        self.power_cycle()

    async def open(self, url: str, *, baud: int) -> Port:
        """Open; see `mkdaemon.link.ports.port.open_port`.

        Raises:
            LinkLostError: the device is not there.
            LinkError: somebody else has it.
        """
        if not self.is_present:
            raise LinkLostError(f"no serial port {url}: plug it in")
        if self.port is not None and not self.port.is_closed:
            raise LinkError(f"{url} is in use by this very test")
        self.openings += 1
        self.port = BoardPort(self, url, baud)
        return self.port

    def unplug(self) -> None:
        """Pull the cable."""
        self.is_present = False
        if self.port is not None:
            self.port.lose("the device was unplugged or its other end was closed")


class BoardPort:
    """An open port to a simulated board; see `Port`.

    Attributes:
        amount: how much of it, where that has a meaning.
        discarded: bytes that were thrown away before they left.
    """

    def __init__(self, socket: Socket, name: str, baud: int) -> None:
        self.fault = LineFault.NONE
        self.amount = 0.0
        self.is_closed = False
        self._socket = socket
        self._name = name
        self._baud = baud
        self._inbox = bytearray()
        self._stuck = self.discarded = 0
        self._loss: str | None = None
        self._arrived = asyncio.Event()
        self._decoder = FrameDecoder()
        self._loop = asyncio.get_running_loop()
        self._timer = self._loop.call_later(socket.tick, self._tick)
        socket.aircraft.advance(socket.now())  # what was said while nobody listened is gone

    @property
    def name(self) -> str:
        """The address it was opened under."""
        return self._name

    @property
    def backlog(self) -> int:
        """Bytes a stuck writer holds."""
        return self._stuck

    def discard(self) -> None:
        """Throw away what a stuck writer holds."""
        self.discarded += self._stuck
        self._stuck = 0

    @property
    def descriptor(self) -> int | None:
        """A number that stands for a device: boards in virtual time have none."""
        return 0

    @property
    def is_recording(self) -> bool:
        """False."""
        return False

    async def read(self) -> bytes:
        """Return what arrived; see `Port.read`."""
        while not self._inbox:
            if self._loss is not None:
                raise LinkLostError(f"{self._name}: {self._loss}")
            self._arrived.clear()
            await self._arrived.wait()
        size = 1 if self.fault is LineFault.ONE_BYTE_AT_A_TIME else len(self._inbox)
        chunk = bytes(self._inbox[:size])
        del self._inbox[:size]
        return chunk

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Port.write`."""
        if self._loss is None and self.fault is LineFault.GONE_DURING_WRITE:
            self._socket.is_present = False
            self.lose("the device was unplugged or its other end was closed")
        if self._loss is None and self.fault is LineFault.DEVICE_FULL:
            self.lose("the device is full and takes no more bytes")
        if self._loss is not None:
            raise LinkLostError(f"{self._name}: {self._loss}")
        socket = self._socket
        socket.wire.append((socket.now(), data))
        if self.fault is LineFault.STUCK_WRITER:
            self._stuck += len(data)
        elif self.fault is not LineFault.ONE_WAY and self._baud == socket.right_baud:
            socket.aircraft.write(self._spoil(data), socket.now())

    async def drain(self) -> None:
        """Return at once: virtual bytes need no draining."""

    async def close(self) -> None:
        """Let the device go."""
        self.is_closed = True
        self._timer.cancel()
        self.lose("closed")

    def lose(self, reason: str) -> None:
        """End the port as a vanished device does."""
        self._loss = self._loss or reason
        self._arrived.set()

    def inject(self, fault: LineFault, amount: float = 0.05) -> None:
        """Begin a fault; NONE ends it."""
        self.fault, self.amount = fault, amount
        if fault is LineFault.REBOOT:
            for name in ("fc_reboot", "nc_reboot") if self._socket.aircraft.navigation else ("fc_reboot",):
                self._socket.aircraft.world.faults.start(name)
        if fault is LineFault.UNPLUGGED:
            self._socket.unplug()
        if fault is not LineFault.STUCK_WRITER:
            self._stuck = 0

    def _tick(self) -> None:
        socket = self._socket
        self._timer = self._loop.call_later(socket.tick, self._tick)
        now = socket.now()
        said = b"".join(chunk for _, chunk in socket.aircraft.advance(now))
        flight = socket.aircraft.flight
        is_reset = not socket.aircraft.world.faults.is_active("fc_reboot")
        if self.fault is LineFault.REBOOT and is_reset and now >= flight.booted_at:
            self.fault = LineFault.NONE
        self._deliver(self._corrupt(said))

    def _deliver(self, data: bytes) -> None:
        if data and self._loss is None:
            self._inbox += data
            self._arrived.set()

    def _corrupt(self, said: bytes) -> bytes:
        """What the host receives of what the board said."""
        rng, fault = self._socket.rng, self.fault
        if self._baud != self._socket.right_baud or fault is LineFault.GARBAGE:
            size = max(len(said), 2 if fault is LineFault.GARBAGE else 0)
            return bytes(rng.randrange(0x80, 0x100) for _ in range(size))
        if fault is LineFault.TEXT_FLOOD:
            return b"GPS: no fix yet, waiting\r\n"[: rng.randrange(6, 26)]
        if fault is LineFault.SILENCE:
            return b""
        if fault is LineFault.ECHO_ONLY:
            frames = self._decoder.feed(said)
            return b"".join(item.raw for item in frames if isinstance(item, Frame) and item.id in "ZV")
        return self._spoil(said)

    def _spoil(self, data: bytes) -> bytes:
        rng = self._socket.rng
        if self.fault is LineFault.BYTE_LOSS:
            return bytes(byte for byte in data if rng.random() >= self.amount)
        if self.fault is LineFault.BIT_FLIPS:
            return bytes(byte ^ (1 << rng.randrange(8)) if rng.random() < self.amount else byte for byte in data)
        return data
