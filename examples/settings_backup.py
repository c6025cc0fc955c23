"""Save all parameter sets of the FlightCtrl, change one parameter, show the difference, and restore the backup."""

import asyncio
import sys
from pathlib import Path

from mkdaemon.client import connect
from mkdaemon.client.settings_files import read_sets
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import spell_changes


async def main(folder: Path) -> None:
    async with connect() as uav:
        files = await uav.settings.backup_to(folder, on_progress=lambda progress: print(progress.text))
        print("saved:", ", ".join(file.name for file in files))
        await uav.settings.write({"gyro_p": 81}, slot=2, confirm=True)
        found = await uav.settings.compare_with(folder)
        saved = {slot: one.parameters for slot, one in read_sets(folder).items()}
        for stored in found.stored:
            for change in spell_changes(saved[stored.slot], ParameterSet.from_payload(stored.raw)):
                print(f"set {stored.slot}: {change.name} was {change.before}, is {change.after}")
        done = await uav.settings.restore_from(folder, confirm=True)
        print("restored sets:", *done.written, "- live again:", done.active)


asyncio.run(main(Path(sys.argv[1] if len(sys.argv) > 1 else "backup")))
