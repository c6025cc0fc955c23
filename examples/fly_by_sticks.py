"""Fly a small square by sticks: no target is needed, nothing corrects the drift. The pilot hovers and hands over."""

import asyncio

from mkdaemon.client import connect

SIDES = {"north": (12, 0), "east": (0, 12), "south": (-12, 0), "west": (0, -12)}  # pitch, roll [stick]
THROTTLE = -1  # a little more than the simulated aircraft needs to hover [stick]


async def main() -> None:
    async with connect() as uav, uav.lease() as lease:
        for name, (pitch, roll) in SIDES.items():
            await lease.stick(pitch=pitch, roll=roll, throttle=THROTTLE, seconds=1.0)  # lean to get going
            await lease.stick(pitch=-pitch, roll=-roll, throttle=THROTTLE, seconds=1.3)  # lean back to stop
            position = await uav.state.position.latest()
            if position is not None:
                print(name, position.value.position_enu)


asyncio.run(main())
