"""A MAVSDK program in a process of its own: does what its arguments say and prints a line of JSON for each.

`python -m tests.gateways.mavlink.mavsdkprogram URL STEP...`; it is killed in the tests, as a user's program may be.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk, MavsdkError
from mavsdk.asyncio.plugins import action, component_metadata, mission_raw, offboard, param, telemetry

LATITUDE, LONGITUDE = 532_301_184, 74_590_749
SUBSCRIBED = (
    "position", "home", "in_air", "landed_state", "armed", "attitude_euler", "attitude_quaternion", "gps_info",
    "battery", "flight_mode", "health", "rc_status", "odometry", "velocity_ned", "unix_epoch_time", "raw_gps",
    "altitude",
)  # fmt: skip
ITEMS = [
    mission_raw.MissionItem(0, 6, 16, 1, 1, 2.0, 5.0, 0.0, float("nan"), LATITUDE, LONGITUDE, 10.25, 0),
    mission_raw.MissionItem(1, 6, 195, 0, 1, 0.0, 0.0, 0.0, 0.0, LATITUDE, LONGITUDE + 900, 0.0, 0),
    mission_raw.MissionItem(2, 6, 16, 0, 1, 0.0, 3.0, 0.0, float("nan"), LATITUDE + 900, LONGITUDE - 700, 12.0, 0),
    mission_raw.MissionItem(3, 6, 19, 0, 1, 7.0, 0.0, 0.0, float("nan"), LATITUDE + 500, LONGITUDE, 11.0, 0),
]
SPEED = mission_raw.MissionItem(1, 2, 178, 0, 1, 1.0, 3.0, -1.0, 0.0, 0, 0, 0.0, 0)
"""A NaviCtrl 0.24 has no speeds."""


def tell(step, **found):
    """Print what was found."""
    print(json.dumps({"step": step, "at": time.monotonic(), **found}, default=str), flush=True)


async def subscribe(system):
    """Wait for one value of everything that is subscribed to."""
    source = telemetry.TelemetryAsync(system)

    async def first(name):
        return str(await anext(getattr(source, f"subscribe_{name}")()))

    async with asyncio.timeout(60.0):
        found = await asyncio.gather(*(first(name) for name in SUBSCRIBED))
    return dict(zip(SUBSCRIBED, found, strict=True))


async def mission(system):
    """Upload a mission and download it; before it one that this NaviCtrl cannot fly."""
    source = mission_raw.MissionRawAsync(system)
    try:
        await source.upload_mission([ITEMS[0], SPEED, ITEMS[2]])
        refused = ""
    except MavsdkError as error:
        refused = str(error).partition(";")[0]
    await source.upload_mission(ITEMS)
    found = await source.download_mission()
    return {
        "same": [str(item) for item in found] == [str(item) for item in ITEMS],
        "count": len(found),
        "refused": refused,
    }


async def north(system, fly, metres):
    """Stream a place and wait until the aircraft is there."""
    source = telemetry.TelemetryAsync(system)
    await fly.set_position_ned(offboard.PositionNedYaw(metres, 0.0, -2.0, 0.0))
    async with asyncio.timeout(40.0):
        async for value in source.subscribe_position_velocity_ned():
            if abs(value.position.north_m - metres) < 0.15:
                break
    return {}


async def step(system, fly, word):
    """Do one step; what is printed of it. The plug-in that streams lives as long as the program."""
    name, _, number = word.partition("=")
    match name:
        case "subscribe":
            return await subscribe(system)
        case "mission":
            return await mission(system)
        case "offboard":
            await fly.set_position_ned(offboard.PositionNedYaw(0.0, 0.0, -2.0, 0.0))
            await fly.start()
        case "north":
            return await north(system, fly, float(number))
        case "stop":
            await fly.stop()
        case "param":
            found = await param.ParamAsync(system).get_all_params()
            return {"params": {one.name: one.value for one in found.float_params}}
        case "wait":
            await asyncio.sleep(float(number))
        case "height":
            async with asyncio.timeout(60.0):
                async for value in telemetry.TelemetryAsync(system).subscribe_position_velocity_ned():
                    if -value.position.down_m > float(number):
                        break
        case "metadata":  # what each parameter means
            source = component_metadata.ComponentMetadataAsync(system)
            found = asyncio.create_task(anext(described(source)))
            await asyncio.sleep(0.5)  # it listens
            await source.request_autopilot_component()
            async with asyncio.timeout(60.0):
                rows = json.loads((await found).json_metadata)["parameters"]
            return {"parameters": {row["name"]: row["shortDesc"] for row in rows}}
        case "health":  # what MAVSDK's own examples wait for before they arm
            async with asyncio.timeout(60.0):
                async for health in telemetry.TelemetryAsync(system).subscribe_health():
                    if health.is_global_position_ok and health.is_home_position_ok:
                        break
        case "ground":
            async with asyncio.timeout(90.0):
                async for state in telemetry.TelemetryAsync(system).subscribe_flight_mode():
                    if state == telemetry.FlightMode.STABILIZED:
                        break
        case _:
            await getattr(action.ActionAsync(system), name)()
    return {}


async def described(source):
    """Metadata of parameters, as they come."""
    async for update in source.subscribe_metadata_available():
        if int(update.type) == 1:  # COMP_METADATA_TYPE_PARAMETER
            yield update


async def main(url, *words):
    """Do all steps; a failure of one is printed and ends it."""
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=60.0)
        tell("connected", autopilot=int(await system.autopilot_type()))
        texts, fly = asyncio.create_task(listen(system)), offboard.OffboardAsync(system)
        for word in words:
            try:
                tell(word, **await step(system, fly, word))
            except (MavsdkError, TimeoutError) as error:
                tell(word, error=str(error))
                break
        texts.cancel()


async def listen(system):
    """Print every text of the aircraft."""
    async for text in telemetry.TelemetryAsync(system).subscribe_status_text():
        tell("text", text=text.text)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
