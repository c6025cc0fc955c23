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
from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Final

import msgpack
from mcap.exceptions import EndOfFile
from mcap.stream_reader import StreamReader

from lab.campaign import Row
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


Witnessed = list[tuple[float, float]]
"""When each frame was received, and its stamp [s]."""
VICTIMS: Final = {"daemon": (BLACK_BOX,), "recorder": (GROUND,), "both": (BLACK_BOX, GROUND)}
"""What is killed, and where its files are."""


async def kill(victim: str, seed: int) -> Row:
    """Kill a daemon while it records, a recorder on the ground, or both at once; what they leave, together."""
    async with _flight(seed) as (folder, daemon, witnessed), AsyncExitStack() as stack:
        killed: list[Program] = [] if victim == "recorder" else [daemon]
        if victim != "daemon":
            killed.append(await stack.enter_async_context(_recorder(folder / GROUND, daemon.endpoint)))
        await wait_until(lambda: len(witnessed) > 5)
        began = time.monotonic()
        await asyncio.sleep(random.Random(f"{victim} {seed}").uniform(0.0, LONGEST))
        killed_at = time.monotonic()
        for one in killed:
            one.send_signal(signal.SIGKILL)
        for one in killed:
            await one.end(signal.SIGKILL)
        return sum_up(_look(folder / name, witnessed, began, killed_at) for name in VICTIMS[victim])


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
async def _flight(seed: int) -> AsyncIterator[tuple[Path, DaemonProcess, Witnessed]]:
    """A simulated aircraft, a daemon on it, and the frames that a witness of what it publishes receives."""
    witnessed: Witnessed = []

    def take(sample: Sample) -> None:
        witnessed.append((time.monotonic(), sample.fields["stamp"]["monotonic"]))

    async with (
        flown(observed(seed, "2.14", "2.14", calibrated=False), waits=False) as one,
        following(one.client, take, FRAMES),
    ):
        yield one.folder, one.daemon, witnessed


def _look(folder: Path, witnessed: Witnessed, began: float, killed_at: float) -> Row:
    """What a program left in its files.

    Returns:
        `entries`; `age` of the newest one when the program was killed, of the recording where it has none [s];
        `missing` frames, which the witness had received more than `ALLOWED` before and are newer than all of the file;
        `gaps`, entries missing by the recorder's numbers; files that are `unreadable`: the `mcap` library does not read
        them to their end, or the recovered file is not whole.
    """
    row = {"entries": 0, "age": 0.0, "missing": 0, "gaps": 0, "unreadable": 0}
    newest, stamps = began, set[float]()
    for path in sorted(folder.glob("*.mcap")):
        recording = Recording(path)
        for entry in recording.entries():
            row["entries"] += 1
            newest = max(newest, entry.received)
            if entry.kind is EntryKind.SAMPLE and entry.key == f"mk/{VEHICLE}/{FRAMES}":
                stamps.add(msgpack.unpackb(entry.payload)["stamp"]["monotonic"])
        row["gaps"] += recording.report.lost
        row["unreadable"] += not (_streams(path) and _recovers(path, folder / "recovered"))
    last = max(stamps, default=began)
    missing = {stamp for at, stamp in witnessed if at < killed_at - ALLOWED and stamp > last}
    return row | {"age": killed_at - newest, "missing": len(missing)}


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


def sum_up(rows: Iterable[Row]) -> Row:
    """Several files, or several kills, as one: the oldest end, and everything else together."""
    every = list(rows)
    counts = ("entries", "missing", "gaps", "unreadable")
    return {"age": max(row["age"] for row in every)} | {name: sum(row[name] for row in every) for name in counts}


def is_kept(left: Row) -> bool:
    """Whether kills left what docs/lab/recording.md promises."""
    return left["age"] <= ALLOWED and not any(left[name] for name in ("missing", "gaps", "unreadable"))
