"""Record what the vehicle puts on the bus for some seconds, with a mark, and read the recording back."""

import asyncio
import sys
from collections import Counter
from pathlib import Path

from mkdaemon.client import connect
from mkdaemon.client.export.values import read_values
from mkdaemon.telemetry.state import Attitude

SECONDS = 3.0


async def record(folder: Path) -> Path:
    async with connect() as uav, uav.records.record(folder) as recording:
        async with uav.event.mark.subscribed() as marks:
            await uav.records.mark("the interesting part begins")
            print("marked:", (await anext(marks)).text)
        await asyncio.sleep(SECONDS)
    file = recording.report.file
    assert file is not None, "nothing was written"
    return file


def read(file: Path) -> None:
    counts, rolls = Counter[str](), []
    for value in read_values(file):
        counts[value.suffix] += 1
        if isinstance(value.typed, Attitude):
            rolls.append(value.typed.roll)
    print(f"{counts.total()} values of {len(counts)} keys, {counts['event/mark']} mark")
    print(f"roll between {min(rolls):+.3f} and {max(rolls):+.3f} rad in {len(rolls)} attitudes")


read(asyncio.run(record(Path(sys.argv[1] if len(sys.argv) > 1 else "recordings"))))
