"""A MAVSDK program in a process of its own: uploads a mission in a local frame, flies it, pauses it and goes on.

`python -m tests.gateways.mavlink.mavsdkpath URL`; it prints a line of JSON for each step.
"""

from __future__ import annotations

import asyncio
import sys

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk, MavsdkError
from mavsdk.asyncio.plugins import mission_raw

from tests.gateways.mavlink.mavsdkprogram import tell

STILL = float("nan")


def point(seq, north, east, frame=1):
    place = (round(north * 1e4), round(east * 1e4), -2.0)
    return mission_raw.MissionItem(seq, frame, 16, int(seq == 0), 1, 0.0, 0.0, 0.0, STILL, *place, 0)


PATH = [point(0, 0.0, 0.0), point(1, 1.0, 0.0), point(2, 1.0, 0.5)]


async def main(url):
    """Do all steps; one that is refused is printed with its error."""
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        source = mission_raw.MissionRawAsync(await mavsdk.first_autopilot(timeout_s=60.0))
        for items in (PATH[:1], [*PATH[:2], point(2, 1.0, 0.5, frame=6)], [*PATH[:2], point(2, 90.0, 0.0)], PATH):
            try:
                await source.upload_mission(items)
                tell("uploaded")
            except MavsdkError as error:
                tell("refused", error=str(error).partition(";")[0])
        tell("downloaded", same=[str(item) for item in await source.download_mission()] == [str(item) for item in PATH])
        for word, step in (
            ("started", source.start_mission),
            ("paused", source.pause_mission),
            ("continued", source.start_mission),
        ):
            await step()
            tell(word)
            await asyncio.sleep(2.0)  # several setpoints leave, also on a busy machine
        async with asyncio.timeout(120.0):
            async for progress in source.subscribe_mission_progress():
                if progress.current == 2:
                    tell("progress", current=progress.current, total=progress.total)
                    break


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
