"""The daemon is killed and started anew in flight, behind a NaviCtrl: the first frames take the old command away.

In virtual time. Each new daemon knows what the note of the flight says; it steers only after a client has confirmed
the FlightCtrl, and in the right layout.
"""

from __future__ import annotations

import asyncio
import random
from typing import Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.boardport import TICK_TIME, Socket
from lab.rigs.cockpit import Boards, Cockpit, cockpit
from lab.rigs.waiting import in_virtual_time, running
from lab.stories.standstills import Streamer, is_tilted
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.knownflight import FlightMemory
from mkdaemon.telemetry.refusals import Token

LIMITS: Final[dict[str, float | str]] = {"cleared": 0.35, "steered": 0, "token": Token.REMEMBERED_ONLY}
"""Of one restart; see `restart`."""
WATCH: Final = 2.0
"""How long a new daemon is watched before a client confirms [s]."""
IN_FLIGHT_GAS: Final = 60


@in_virtual_time
async def restart(boards: Boards, seed: int, *, count: int, tick: float = TICK_TIME) -> list[Row]:
    """Kill and start the daemon of one flight again and again; bytes are carried every `tick` [s].

    Returns:
        Of each `cleared`, when the FlightCtrl held no command any more, from the first bytes [s], None where it did at
        the end; `steered`, frames with the valid bit before a client confirmed the FlightCtrl; `token`, why a lease
        without the confirmation was refused, empty where it was granted; `layout`, in which the confirmed lease flew.
    """
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
    async with running(Streamer(flown, name).fly(use_remembered=use_remembered)):
        await flown.until(lambda: flown.aircraft.is_controlled and is_tilted(flown.sink.tx[-40:]))
        await asyncio.sleep(0.5)
        memory, port = flown.link.flight_memory, flown.socket.port
        assert memory is not None and port is not None
        port.lose("the program was killed")
    return memory


async def _begin_again(
    boards: Boards, socket: Socket, memory: FlightMemory, number: int, layout: str
) -> tuple[Row, FlightMemory]:
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
        flew = flown.link.dialect.extern_control_layout or "none"
    return judged(LIMITS | {"layout": layout}, cleared=cleared, steered=steered, token=token, layout=flew), memory
