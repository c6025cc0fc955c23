"""The daemon is killed and started anew in flight, behind a NaviCtrl: the first frames take the old command away.

In virtual time. Each new daemon knows what the note of the flight says; it steers only after a client has confirmed
the FlightCtrl, and in the right layout.
"""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass
from typing import Final

from lab.rigs.boardport import TICK_TIME, Socket
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.stories.standstills import Streamer, is_tilted
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.knownflight import FlightMemory
from mkdaemon.telemetry.refusals import Token
from mkdaemon.virtualtime import run_virtually

CLEARED: Final = 0.35
"""The old command is taken away so long after the first bytes of the new daemon [s]."""
WATCH: Final = 2.0
"""How long a new daemon is watched before a client confirms [s]."""
IN_FLIGHT_GAS: Final = 60


@dataclass(frozen=True, slots=True)
class Restart:
    """One restart.

    Attributes:
        number: within the session.
        cleared: the FlightCtrl held no command any more, from the first bytes [s]; None where it did at the end.
        steered: frames with the valid bit before a client confirmed the FlightCtrl.
        token: why a lease without the confirmation was refused; empty where it was granted.
        layout: in which the confirmed lease flew; empty for none.
        expected: the layout of the aircraft.
    """

    number: int
    cleared: float | None
    steered: int
    token: str
    layout: str
    expected: str

    @property
    def is_wrong(self) -> bool:
        """Whether it breaks a limit."""
        is_late = self.cleared is None or self.cleared > CLEARED
        is_other = self.layout != self.expected or not self.layout
        return is_late or self.steered > 0 or self.token != Token.REMEMBERED_ONLY or is_other


def restart(boards: Boards, seed: int, *, count: int, tick: float = TICK_TIME) -> list[Restart]:
    """Kill and start the daemon of one flight again and again; bytes are carried every `tick` [s]."""
    return run_virtually(_restart(boards, seed, count, tick))


async def _restart(boards: Boards, seed: int, count: int, tick: float) -> list[Restart]:
    async with cockpit(boards, seed, tick=tick, rates={"osd": 200}) as flown:
        await asyncio.sleep(1.0)
        flown.aircraft.world.pilot.gas = IN_FLIGHT_GAS
        flown.aircraft.flight.core.start()
        await asyncio.sleep(5.0)
        socket, memory = flown.socket, await _fly_and_die(flown, "client", use_remembered=False)
        layout = flown.link.dialect.extern_control_layout or ""
    found = []
    for number in range(count):
        await asyncio.sleep(random.Random(f"{seed} restart {number}").uniform(0.1, 1.5))
        one, memory = await _begin_again(boards, socket, memory, number, layout)
        found.append(one)
    return found


async def _fly_and_die(flown: Cockpit, name: str, *, use_remembered: bool) -> FlightMemory:
    """Fly with a tilt, then end as a killed process does; returns what the note says."""
    flying = asyncio.create_task(Streamer(flown, name).fly(use_remembered=use_remembered), name="client")
    await flown.until(lambda: flown.aircraft.is_controlled and is_tilted(flown.sink.tx[-40:]))
    await asyncio.sleep(0.5)
    memory, port = flown.link.flight_memory, flown.socket.port
    assert memory is not None
    assert port is not None
    port.lose("the program was killed")
    flying.cancel()
    await asyncio.gather(flying, return_exceptions=True)
    return memory


async def _begin_again(
    boards: Boards, socket: Socket, memory: FlightMemory, number: int, layout: str
) -> tuple[Restart, FlightMemory]:
    was_controlled = not socket.aircraft.flight.external.is_valid
    written = len(socket.wire)
    async with cockpit(boards, number, socket=socket, rates={"osd": 200}) as flown:
        flown.link.recall_flight(memory)
        await flown.until(lambda: len(socket.wire) > written)
        began = socket.now()
        took = await flown.until(lambda: not flown.aircraft.is_controlled, within=6.0)
        cleared = 0.0 if was_controlled else None if took is None else socket.now() - began
        await asyncio.sleep(WATCH)
        frames = [frame.message for frame in flown.sink.tx]
        steered = sum(bool(int(getattr(message, "config", 0)) & 1) for message in frames)
        token = ""
        try:
            await flown.take("nobody")
        except CommandRejectedError as error:
            token = error.token
        memory = await _fly_and_die(flown, f"client{number}", use_remembered=True)
        found = Restart(number, cleared, steered, token, flown.link.dialect.extern_control_layout or "", layout)
    return found, memory
