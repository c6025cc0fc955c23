"""A controller of your own: velocities from the newest estimate, under a lease, until it is there; then hold.

It pulls the aircraft to a point over the target. Every setpoint holds for 0.3 s: when this program hangs, the daemon
levels the aircraft, and after one second it gives it back to the pilot.
"""

import asyncio
from math import dist

from mkdaemon.client import connect
from mkdaemon.errors import SilenceError

GOAL = (0.3, -0.3, 1.8)  # in the frame of the target [m]
GAIN, FASTEST, NEAR = 0.6, 0.3, 0.15  # [1/s], [m/s], [m]
LONGEST = 20.0  # [s]


def velocity_to(goal: tuple[float, ...], position: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = (max(-FASTEST, min(FASTEST, GAIN * (g - p))) for g, p in zip(goal, position, strict=True))
    return x, y, z


async def main() -> None:
    async with connect() as uav, uav.lease() as lease:
        await lease.hold(seconds=0.5)  # streams until the daemon engages, then the estimates come
        try:
            async with asyncio.timeout(LONGEST):
                async for estimate in uav.control.estimate(backlog=1, silence=0.5):  # the newest alone
                    if dist(estimate.position, GOAL) < NEAR:
                        print("there")
                        break
                    lease.set.velocity(velocity=velocity_to(GOAL, estimate.position), frame="pad")
        except (TimeoutError, SilenceError) as why:
            print("stopped:", why or "too slow")
        await lease.hold(seconds=2.0)  # what is streamed last decides what the aircraft does until it is given back
    print("given back")


asyncio.run(main())
