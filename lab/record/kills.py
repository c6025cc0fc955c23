"""`kill -9` of the daemon, of the recorder on the ground, and of both: what is left, and how old its end is.

A witness in this process receives the raw frames, with the machine's own monotonic time. What it received more than
`ALLOWED` before the kill must be in the file, every one of it. A frame is known by its stamp: numbers begin again where
the line is opened anew.
"""

from __future__ import annotations

import asyncio
import io
import random
import signal
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgpack
from mcap.exceptions import EndOfFile
from mcap.stream_reader import StreamReader

from lab.rigs.flown import flown, observed
from lab.rigs.processes import MKCTL, VEHICLE, DaemonProcess, Program
from lab.rigs.waiting import following, wait_until
from mkdaemon.client import Sample
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.reader import Recording
from mkdaemon.record.rewrite import recover

ALLOWED: Final = 1.1
"""Nothing older than this may be lost [s]."""
LONGEST: Final = 3.0
"""A program is killed at a random moment of so many seconds after its first entry [s]."""
FRAMES: Final = "raw/rx"
BLACK_BOX: Final = "state/recordings"
GROUND: Final = "ground"


@dataclass(frozen=True, slots=True)
class Left:
    """What a kill left.

    Attributes:
        entries: in the files.
        age: of the newest entry when the program was killed; of the recording where it has none [s].
        missing: frames the witness had received more than `ALLOWED` before, newer than all of the file.
        on_the_way: frames that the witness had and the file has not, between others: the bus lost them before the
            recorder had them, where its own numbers have no gap.
        gaps: entries missing by the recorder's numbers.
        is_readable: whether the `mcap` library reads it to its end, and the recovered file is whole.
    """

    entries: int
    age: float
    missing: int
    on_the_way: int
    gaps: int
    is_readable: bool


class Witness:
    """Remembers the frames it received: when, and their stamps [s]."""

    def __init__(self) -> None:
        self.frames: list[tuple[float, float]] = []

    def take(self, sample: Sample) -> None:
        """Remember one."""
        self.frames.append((time.monotonic(), sample.fields["stamp"]["monotonic"]))


VICTIMS: Final = {"daemon": (BLACK_BOX,), "recorder": (GROUND,), "both": (BLACK_BOX, GROUND)}
"""What is killed, and where its files are."""


async def kill(victim: str, seed: int) -> Left:
    """Kill a daemon while it records, a recorder on the ground, or both at once; the worse of what they leave."""
    async with _flight(seed) as (folder, daemon, witness), AsyncExitStack() as stack:
        killed: list[Program] = [] if victim == "recorder" else [daemon]
        if victim != "daemon":
            killed.append(await stack.enter_async_context(_recorder(folder / GROUND, daemon.endpoint)))
        await wait_until(lambda: len(witness.frames) > 5)
        began = time.monotonic()
        await asyncio.sleep(random.Random(f"{victim} {seed}").uniform(0.0, LONGEST))
        killed_at = time.monotonic()
        for one in killed:
            one.send_signal(signal.SIGKILL)
        for one in killed:
            await one.end(signal.SIGKILL)
        found = [_look(_files(folder / name), witness, began, killed_at, folder) for name in VICTIMS[victim]]
    return Left(
        entries=sum(one.entries for one in found),
        age=max(one.age for one in found),
        missing=sum(one.missing for one in found),
        on_the_way=sum(one.on_the_way for one in found),
        gaps=sum(one.gaps for one in found),
        is_readable=all(one.is_readable for one in found),
    )


@asynccontextmanager
async def _recorder(folder: Path, endpoint: str) -> AsyncIterator[Program]:
    """`mkctl log record` into a folder, as soon as it writes; it does not outlive the context."""
    recorder = await Program.start(*MKCTL, "log", "record", "--folder", str(folder), "--connect", endpoint)
    try:
        await wait_until(lambda: any(folder.glob("*.mcap")))
        yield recorder
    finally:
        await recorder.end(signal.SIGKILL)


@asynccontextmanager
async def _flight(seed: int) -> AsyncIterator[tuple[Path, DaemonProcess, Witness]]:
    """A simulated aircraft, a daemon on it, and a witness of what it publishes."""
    witness = Witness()
    async with (
        flown(observed(seed, "2.14", "2.14", calibrated=False), waits=False) as one,
        following(one.client, witness.take, FRAMES),
    ):
        yield one.folder, one.daemon, witness


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


def _look(files: Sequence[Path], witness: Witness, began: float, killed_at: float, folder: Path) -> Left:
    entries, newest, gaps = 0, began, 0
    stamps: set[float] = set()
    is_readable = True
    for path in files:
        recording = Recording(path)
        for entry in recording.entries():
            entries += 1
            newest = max(newest, entry.received)
            if entry.kind is EntryKind.SAMPLE and entry.key == f"mk/{VEHICLE}/{FRAMES}":
                stamps.add(msgpack.unpackb(entry.payload)["stamp"]["monotonic"])
        gaps += recording.report.lost
        is_readable = is_readable and _streams(path) and _recovers(path, folder / "recovered.mcap")
    first, last = min(stamps, default=began), max(stamps, default=began)
    wanted = {stamp for at, stamp in witness.frames if at < killed_at - ALLOWED and stamp >= first}
    lacking = wanted - stamps
    missing = sum(stamp > last for stamp in lacking)
    return Left(entries, killed_at - newest, missing, len(lacking) - missing, gaps, is_readable)


def _streams(path: Path) -> bool:
    """Whether the library reads every record up to the end of the file."""
    content = path.read_bytes()
    stream = io.BytesIO(content)
    try:
        for _ in StreamReader(stream, validate_crcs=True).records:
            pass
    except EndOfFile:
        return stream.tell() == len(content)
    except Exception:  # noqa: BLE001  # whatever it stumbles over counts
        return False
    return True


def _recovers(path: Path, target: Path) -> bool:
    if next(Recording(path).entries(), None) is None:
        return True  # it was killed before its first flush
    recover(path, target, overwrite=True)
    recovered = Recording(target)
    return sum(1 for _ in recovered.entries()) > 0 and recovered.report.is_whole


def sum_up(results: Sequence[Left]) -> dict[str, Any]:
    """Figures of many kills."""
    ages = sorted(one.age for one in results)
    return {
        "kills": len(results),
        "age_max_s": ages[-1],
        "age_median_s": ages[len(ages) // 2],
        "older_than_allowed": sum(age > ALLOWED for age in ages),
        "frames_missing": sum(one.missing for one in results),
        "frames_lost_on_the_way": sum(one.on_the_way for one in results),
        "gaps": sum(one.gaps for one in results),
        "unreadable": sum(not one.is_readable for one in results),
        "entries": sum(one.entries for one in results),
    }
