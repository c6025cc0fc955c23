"""Fly a square over a target in sight, by positions. The pilot hovers over it and hands over: docs/flying.md."""

import asyncio

from mkdaemon.client import connect

HEIGHT = 2.0  # above the target [m]
CORNERS = {"middle": (0, 0), "east": (0.4, 0), "north": (0.4, 0.4), "west": (0, 0.4), "south": (0, 0)}


async def main() -> None:
    async with connect() as uav, uav.lease() as lease:
        for name, (x, y) in CORNERS.items():
            await lease.goto(x, y, HEIGHT, seconds=3.0)
            estimate = await uav.control.estimate.latest()
            if estimate is not None:
                print(name, *(f"{metres:+.2f}" for metres in estimate.value.position))
    # Leaving the context gives the aircraft back to the pilot, also after an error or Ctrl-C.


asyncio.run(main())
