"""Disks that are full or gone under a daemon that flies: the file stays readable."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any, Final

from lab.rigs.flown import flown, observed
from lab.rigs.waiting import following, wait_until
from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.record.reader import Recording
from mkdaemon.record.recorder import RETRY

SMALL: Final = "4m"
"""Size of the disk that is filled."""
WATCH: Final = 4.0
"""How long the daemon is watched with a disk that fails [s]."""


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A disk in memory while the context lasts.

    Raises:
        MkError: this user may not mount one.
    """
    place = folder / "disk"
    place.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", f"size={SMALL}", "tmpfs", str(place)]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    if ended.returncode:
        msg = f"a small disk cannot be mounted: {ended.stderr.strip()}; run it as root"
        raise MkError(msg)
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=False)


async def fill_disk(seed: int) -> dict[str, Any]:
    """Fill the disk under a recording, then make room again."""
    with tempfile.TemporaryDirectory() as name, small_disk(Path(name)) as disk:
        section = f'[record]\nfolder = "{disk}/recordings"\nfree_mb = 1\n'
        async with _flying(seed, Path(name), section) as (client, frames):
            await wait_until(lambda: any(disk.glob("recordings/*.mcap")))
            before = await _rate(frames)
            ballast = disk / "ballast"
            with ballast.open("wb") as file:
                while True:
                    try:
                        file.write(bytes(65536))
                        file.flush()
                    except OSError:
                        break
            during = await _rate(frames)
            state = await _state(client)
            readable = [_is_readable(path) for path in sorted(disk.glob("recordings/*.mcap"))]
            ballast.unlink()
            await asyncio.sleep(2 * RETRY)
            after = await _state(client)
            return {
                "frames_per_s_before": before,
                "frames_per_s_full": during,
                "state": state["state"],
                "reason": state["reason"],
                "readable": all(readable) and bool(readable),
                "state_with_room_again": after["state"],
                "lost": after["lost"],
            }


async def remove_folder(seed: int) -> dict[str, Any]:
    """Remove the folder under a recording."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "state" / "recordings"
        async with _flying(seed, Path(name), "") as (client, frames):
            await wait_until(lambda: any(folder.glob("*.mcap")))
            before = await _rate(frames)
            shutil.rmtree(folder)
            during = await _rate(frames)
            await wait_until(lambda: any(folder.glob("*.mcap")))
            await asyncio.sleep(2.0)
            state = await _state(client)
            readable = all(_is_readable(path) for path in folder.glob("*.mcap"))
        return {
            "frames_per_s_before": before,
            "frames_per_s_removed": during,
            "state": state["state"],
            "lost": state["lost"],
            "readable": readable,
        }


@asynccontextmanager
async def _flying(seed: int, folder: Path, section: str) -> AsyncIterator[tuple[Vehicle, list[int]]]:
    """A simulated aircraft, a daemon on it, and a client that counts its frames."""
    frames: list[int] = []

    simulation = observed(seed, "2.14", "2.14", calibrated=False)
    async with (
        flown(simulation, folder=folder, waits=False, link=section) as one,
        following(one.client, lambda sample: frames.append(sample.fields["sequence"]), "raw/rx"),
    ):
        await wait_until(lambda: len(frames) > 20)
        yield one.client, frames


async def _rate(frames: list[int]) -> float:
    """Frames a second, for a while."""
    before = len(frames)
    await asyncio.sleep(WATCH)
    return (len(frames) - before) / WATCH


async def _state(client: Vehicle) -> dict[str, Any]:
    sample = await client.get("record/status")
    return {} if sample is None else sample.fields


def _is_readable(path: Path) -> bool:
    recording = Recording(path)
    entries = sum(1 for _ in recording.entries())
    return entries > 0 and all(damage.length == 0 for damage in recording.report.damages)
