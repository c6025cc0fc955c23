"""Watch the aircraft: attitude as it comes, and once a second battery and link with their age."""

import asyncio
from math import degrees

from mkdaemon.client import Vehicle, connect


async def watch_attitude(uav: Vehicle) -> None:
    async for attitude in uav.state.attitude():
        print(f"roll {degrees(attitude.roll):+.1f}, pitch {degrees(attitude.pitch):+.1f}, from {attitude.source}")


async def watch_battery(uav: Vehicle) -> None:
    while True:
        battery, link = await uav.state.battery.latest(), await uav.link.state.latest()
        if battery is not None and link is not None:
            print(f"{battery.value.voltage:.1f} V {battery.age:.1f} s ago, link {link.value.condition}")
        await asyncio.sleep(1.0)


async def main() -> None:
    async with connect() as uav, asyncio.TaskGroup() as tasks:  # MK_VEHICLE and MK_CONNECT say which one
        tasks.create_task(watch_attitude(uav))
        tasks.create_task(watch_battery(uav))


asyncio.run(main())
