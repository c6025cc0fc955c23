"""The boards on a bench: frames in and out with exact virtual times, on an aircraft that stands still."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from lab.rigs.grounded import GroundedAircraft, Readings, Transmitter
from mkdaemon.protocol.framing import Dropped, Frame, FrameDecoder
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS, NC_GENERATIONS
from mksim.boards.line import HOST_CHAR
from mksim.boards.navictrl import NaviCtrl
from mksim.config import GasLaw
from mksim.physics.sensors import GpsReport
from mksim.physics.world import StickInput

MAG = 3
FIX = GpsReport(532301000, 74591000, 12.0, (0.0, 0.0, 0.0), 9, True, 0.0, 1)


class StillAircraft(GroundedAircraft):
    """Stands still, its pilot's gate open; remembers every change of the sticks, with its time."""

    def __init__(self) -> None:
        readings = Readings(heading_deg=90.0, compass_deg=90.0, gps=FIX, battery_voltage=12.4, battery_current=0.6)
        super().__init__(readings, Transmitter(gas=0, gate=255))
        self.sticks: list[tuple[float, StickInput]] = []

    def step(self, sticks: StickInput) -> None:
        if not self.sticks or self.sticks[-1][1] != sticks:
            self.sticks.append((self.now, sticks))
        super().step(sticks)


class Received(NamedTuple):
    """A frame from a board: when its first and last character was out [s]."""

    first: float
    last: float
    frame: Frame

    @property
    def begins(self) -> float:
        """When its first character began to leave [s]."""
        return self.first - HOST_CHAR


class Bench:
    """One board with a host beside it."""

    def __init__(self, board: FlightCtrl | NaviCtrl, aircraft: StillAircraft) -> None:
        self.board = board
        self.aircraft = aircraft
        self.received: list[Received] = []
        self.dropped: list[Dropped] = []
        self.raw: list[tuple[float, bytes]] = []
        self._decoder = FrameDecoder()
        self._first = 0.0

    def send(self, frame: bytes, at: float) -> float:
        """Put a frame on the line at `at`; return when its CR has arrived, on an idle line [s]."""
        self.board.receive(frame, at)
        return at + len(frame) * HOST_CHAR

    def run(self, to: float) -> list[Received]:
        """Run and return the frames that came meanwhile."""
        before = len(self.received)
        self.board.advance(to)
        for at, byte in self.board.poll():
            self.raw.append((at, byte))
            if byte == b"#":
                self._first = at
            for item in self._decoder.feed(byte):
                if isinstance(item, Frame):
                    self.received.append(Received(self._first, at, item))
                else:
                    self.dropped.append(item)
        return self.received[before:]

    def ask(self, frame: bytes, at: float, patience: float = 0.5) -> Received | None:
        """Send a request and return the first frame that answers within `patience` [s]; compass feeds are no answer."""
        self.send(frame, at)
        came = [received for received in self.run(at + patience) if received.frame.address != MAG]
        return came[0] if came else None

    def ids(self, received: Iterable[Received] | None = None) -> str:
        """Letters of the frames received."""
        return "".join(item.frame.id for item in (self.received if received is None else received))


def fc_bench(
    word: str = "2.12a",
    *,
    seed: int = 1,
    gas_law: GasLaw = GasLaw.STOCK,
    gate_parameter: int = 255,
    calibrated: bool = True,
) -> Bench:
    """A FlightCtrl alone, its receiver good, the pilot's gate open."""
    aircraft = StillAircraft()
    board = FlightCtrl(
        FC_GENERATIONS[word],
        aircraft,
        seed=seed,
        gas_law=gas_law,
        gate_parameter=gate_parameter,
        calibrated=calibrated,
    )
    bench = Bench(board, aircraft)
    bench.run(1.0)
    return bench


def nc_bench(word: str = "0.24", *, fc: str = "2.12a", seed: int = 1, loop_time: float = 0.1e-3) -> Bench:
    """A NaviCtrl with a FlightCtrl behind it."""
    aircraft = StillAircraft()
    flight = FlightCtrl(FC_GENERATIONS[fc], aircraft, seed=seed, gate_parameter=255, calibrated=True)
    bench = Bench(NaviCtrl(NC_GENERATIONS[word], flight, seed=seed, loop_time=loop_time), aircraft)
    bench.run(1.0)
    return bench


def moments(seed: int, count: int, spacing: float, start: float = 1.0) -> Iterator[float]:
    """Times [s] about `spacing` apart, without a fixed phase to any loop of the boards."""
    rng = random.Random(seed)
    at = start
    for _ in range(count):
        at += spacing * rng.uniform(0.9, 1.1)
        yield at


def median(values: Iterable[float]) -> float:
    """Middle value."""
    ordered = sorted(values)
    return ordered[len(ordered) // 2]
