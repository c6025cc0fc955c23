"""A client that holds the lease and floods: `python -m lab.attack.holder ENDPOINT VEHICLE RATE SECONDS FILE END`.

It engages with level sticks at 50 Hz, tilts, then puts as many setpoints a second as RATE says, or all that go for inf,
through a publisher as the client library makes it. After each put it notes the time in FILE, mapped into memory, so
that the time of the last one is known when it is killed. END is `silent`, or `killed`: by SIGKILL, of its own doing.
"""

from __future__ import annotations

import asyncio
import math
import mmap
import os
import signal
import struct
import sys
import time
from pathlib import Path
from typing import Final

from mkdaemon.client import connect
from mkdaemon.client.lease import Lease
from mkdaemon.client.session import FlightSession

NOTE: Final = struct.Struct("<dd")
"""Times of the last put and of the first one of the flood [s; monotonic]; 0 before it."""
TILT: Final = 40.0
"""Of the sticks that are flooded [stick]."""
LINGER: Final = 30.0
"""How long a silent one lives on [s]."""


async def main(endpoint: str, vehicle: str, rate: float, seconds: float, notes: mmap.mmap, *, is_killed: bool) -> None:
    """Fly, flood at a rate [Hz] for a time [s], note when, and end: it kills itself, or falls silent.

    Raises:
        NotEngagedError: the daemon did not begin to send sticks.
    """
    # A hostile client does not ask whether the lease is still its own.
    session = FlightSession(silence=math.inf)
    async with connect(vehicle, endpoint) as uav, uav.lease(session, holder="flood") as lease:
        await lease.stick(throttle=0.0, seconds=0.2)
        await lease.stick(throttle=0.0, pitch=TILT, seconds=0.5)
        sent = _flood(lease, rate, seconds, notes)
        if is_killed:
            os.kill(os.getpid(), signal.SIGKILL)
        print(round(sent / seconds), flush=True)
        await asyncio.sleep(LINGER)


def _flood(lease: Lease, rate: float, seconds: float, notes: mmap.mmap) -> int:
    """Put setpoints, without a look at what the daemon says; returns how many."""
    sticks = {"pitch": TILT, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
    began, sent = time.monotonic(), 0
    while (now := time.monotonic()) < began + seconds:
        due = int((now - began) * rate) if math.isfinite(rate) else sent + 1
        while sent < due:
            lease.put("stick", sticks)
            notes[:] = NOTE.pack(time.monotonic(), began)
            sent += 1
        if math.isfinite(rate):
            time.sleep(0.0005)
    return sent


if __name__ == "__main__":
    _, _endpoint, _vehicle, _rate, _seconds, _file, _end = sys.argv
    with Path(_file).open("r+b") as _opened, mmap.mmap(_opened.fileno(), NOTE.size) as _notes:
        asyncio.run(main(_endpoint, _vehicle, float(_rate), float(_seconds), _notes, is_killed=_end == "killed"))
