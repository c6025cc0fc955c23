"""The daemon itself dies while a client flies: `kill -9` and a new start, or an orderly end by a signal.

Real processes on a pseudo terminal. The client notices nothing and goes on streaming the lease it had.
"""

from __future__ import annotations

import asyncio
import random
import signal
import time
from typing import Any, Final

from lab.campaign import Row
from lab.cases import judged
from lab.rigs.flown import Flown, flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import ObservedSimulation, daemon_process
from lab.rigs.waiting import wait_until
from lab.stories.cable import first_words
from mkdaemon.protocol.framing import Frame, FrameDecoder

LIMITS: Final[dict[str, Any]] = {"first": "release", "steered": 0, "tracebacks": 0}
"""Of every end; see `end_daemon`."""
ORDERLY: Final[dict[str, Any]] = LIMITS | {"took": 2.0, "held": 2.0, "exit_code": 0}
"""Of one that a signal asks for: the release is included [s]."""
WATCH: Final = 2.0
"""How long the boards are watched after a new start has released them [s]."""
SIGNALS: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)


async def end_daemon(fc: str, number: signal.Signals, seed: int) -> Row:
    """Fly, end the daemon this way, and start another one where it was killed.

    Returns:
        `signal`; `took`, until the process was gone [s]; `held`, until the FlightCtrl held no command any more, counted
        from the signal [s]; `first`, what the first bytes of the next daemon were, after a kill, else what the last
        bytes of this one were; `steered`, stick frames with a control bit after that; `released`, from the first bytes
        of the next daemon to Config cleared in the FlightCtrl [s], 0 where it had let go by itself before, None where
        no next one was needed; `exit_code`, without a sign; `tracebacks` in the log.
    """
    rng = random.Random(f"{seed} {fc} {number.name}")
    simulation = observed(seed, fc, keeps=True)
    async with flown(simulation) as one, Pilot(one.client, "pilot") as pilot:
        daemon = one.daemon
        await pilot.engage(lambda: simulation.is_controlled)
        pilot.sticks |= {"pitch": 40.0, "roll": -40.0}
        await asyncio.sleep(rng.uniform(0.2, 0.6))
        simulation.heard.clear()
        began = time.monotonic()
        letting_go = asyncio.create_task(wait_until(lambda: not simulation.is_controlled), name="letting go")
        code = await daemon.end(number)
        took = time.monotonic() - began
        if number is signal.SIGKILL:
            await asyncio.sleep(rng.uniform(0.0, 1.0))
            simulation.heard.clear()
            limits, after = LIMITS, await _restart(one)
        else:
            limits, after = ORDERLY, {"first": last_words(_written(simulation)), "steered": 0, "released": None}
        times = {"took": round(took, 3), "held": round(await letting_go, 3)}
    more = {"exit_code": abs(code), "tracebacks": daemon.errors.count("Traceback")}
    return judged(limits, signal=number.name, **times, **after, **more)


async def _restart(one: Flown) -> Row:
    """Start the next daemon where the killed one was; the client finds it again and streams what it streamed."""
    before, simulation = one.daemon, one.simulation
    async with daemon_process(one.port, one.folder, endpoint=before.endpoint) as daemon:
        await wait_until(lambda: len(_written(simulation)) >= 20)
        opened = simulation.heard[0][0]
        await wait_until(lambda: not simulation.is_controlled)
        released = time.monotonic() - opened
        await asyncio.sleep(WATCH)
        written = _written(simulation)
        before.errors += daemon.errors
        return {"first": first_words(written), "steered": steering(written), "released": round(released, 3)}


def _written(simulation: ObservedSimulation) -> bytes:
    return b"".join(data for _, data in simulation.heard)


def steering(written: bytes) -> int:
    """External control frames among these bytes that are no release."""
    frames = [item for item in FrameDecoder().feed(written) if isinstance(item, Frame) and item.id == "b"]
    return sum(first_words(frame.raw) != "release" for frame in frames)


def last_words(written: bytes) -> str:
    """What bytes end with, as `first_words` says it."""
    frames = [item for item in FrameDecoder().feed(written) if isinstance(item, Frame)]
    return first_words(frames[-1].raw) if frames else "nothing"
