"""Land on the target in sight. The pilot stops the motors afterwards: docs/flying.md."""

import asyncio
import sys

from mkdaemon.client import connect
from mkdaemon.errors import CommandRejectedError, LeaseLostError, ManoeuvreError, NotEngagedError


async def main() -> str | None:
    async with connect() as uav:
        report = await uav.preflight()
        for finding in report.findings:
            if finding.state.value == "stands":
                print(f"{finding.name}: {finding.reason} {finding.fix}")
        try:
            async with uav.lease() as lease:
                await lease.goto(0, 0, 1.0, seconds=4.0)  # over the middle, lower
                await lease.land()
                print("landed:", lease.reason)
        except CommandRejectedError as refused:
            return f"refused ({refused.token}): {refused.reason} {refused.fix}"
        except NotEngagedError as why:
            return f"the daemon did not begin: {why}"
        except (LeaseLostError, ManoeuvreError) as why:
            return f"not landed, the pilot has the aircraft: {why}"
    return None


sys.exit(asyncio.run(main()))
