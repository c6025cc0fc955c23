"""Take off from the target, fly a step, hold, and land. The pilot has started the motors: docs/library.md."""

import asyncio

from mkdaemon.client import connect


async def main() -> None:
    async with connect() as uav, uav.fly(height=1.5) as lease:  # takes off, and holds over the target
        await lease.goto(0.4, 0.0, 1.5)  # metres: right and top of the print, up
        await lease.hold(seconds=5)
    print("landed:", lease.reason)  # leaving the context landed on the target


asyncio.run(main())
