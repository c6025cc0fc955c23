"""`kill -9` of the daemon, and of the recorder on the ground, at random moments: what is left, and how old its end is.

A witness in this process receives the raw frames and their numbers, with the machine's own monotonic time. What it
received more than `ALLOWED` before the kill must be in the file, every number of it.
"""

from __future__ import annotations

import asyncio
import io
import random
import signal
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgpack
from mcap.exceptions import EndOfFile
from mcap.stream_reader import StreamReader

from lab.rigs.processes import VEHICLE, ObservedSimulation, connected, daemon_process
from lab.rigs.waiting import wait_until
from mkdaemon.config.sim import PilotPlan, SimConfig
from mkdaemon.record.entry import Kind
from mkdaemon.record.reader import Recording
from mkdaemon.record.rewrite import recover
from mkdaemon.sim.runtime import Runtime

ALLOWED: Final = 1.1
"""Nothing older than this may be lost [s]."""
LONGEST: Final = 3.0
"""A program is killed at a random moment of so many seconds after its first entry [s]."""
FRAMES: Final = "raw/rx"


@dataclass(frozen=True, slots=True)
class Left:
    """What a kill left.

    Attributes:
        entries: in the files.
        age: of the newest entry when the program was killed; of the recording where it has none [s].
        missing: frames the witness had received more than `ALLOWED` before, and that are in no file.
        gaps: entries missing by their numbers.
        is_readable: whether the `mcap` library reads it to its end, and the recovered file is whole.
    """

    entries: int
    age: float
    missing: int
    gaps: int
    is_readable: bool


class Witness:
    """Remembers the frames it received: when, and their numbers."""

    def __init__(self) -> None:
        self.frames: list[tuple[float, int]] = []

    async def watch(self, samples: AsyncIterator[Any]) -> None:
        """Take samples for ever."""
        async for sample in samples:
            self.frames.append((time.monotonic(), sample.fields["sequence"]))


async def kill_daemon(seed: int) -> Left:
    """Kill a daemon while it records."""
    async with _flight(seed) as (folder, daemon, _):
        recordings = folder / "state" / "recordings"
        async with connected(daemon.endpoint) as client, client.watch(FRAMES) as samples:
            witness = Witness()
            watching = asyncio.create_task(witness.watch(samples))
            await wait_until(lambda: len(witness.frames) > 5)
            began = time.monotonic()
            await asyncio.sleep(random.Random(f"daemon {seed}").uniform(0.0, LONGEST))
            killed_at = time.monotonic()
            await daemon.end(signal.SIGKILL)
            watching.cancel()
        return _look(sorted(recordings.glob("*.mcap")), witness, began, killed_at, folder)


async def kill_recorder(seed: int) -> Left:
    """Kill a recorder on the ground."""
    async with _flight(seed) as (folder, daemon, endpoint):
        words = ("-m", "mkdaemon.cli.mkctl.app", "record", "--folder", f"{folder}/ground", "--connect", endpoint)
        recorder = await asyncio.create_subprocess_exec(
            sys.executable, *words, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL
        )
        try:
            async with connected(daemon.endpoint) as client, client.watch(FRAMES) as samples:
                witness = Witness()
                watching = asyncio.create_task(witness.watch(samples))
                await wait_until(lambda: any((folder / "ground").glob("*.mcap")))
                began = time.monotonic()
                witness.frames.clear()
                await asyncio.sleep(random.Random(f"recorder {seed}").uniform(0.0, LONGEST))
                killed_at = time.monotonic()
                recorder.kill()
                await recorder.wait()
                watching.cancel()
        finally:
            with suppress(ProcessLookupError):
                recorder.kill()
        return _look(sorted((folder / "ground").glob("*.mcap")), witness, began, killed_at, folder)


@asynccontextmanager
async def _flight(seed: int) -> AsyncIterator[tuple[Path, Any, str]]:
    """A simulated aircraft and a daemon on it."""
    config = {"board": "nc", "nc": "2.14", "fc": "2.14", "pilot_plan": PilotPlan.NOTHING, "seed": seed}
    runtime = Runtime(ObservedSimulation(SimConfig.model_validate(config), keeps=False))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with runtime.serve(), daemon_process(f"pty:{runtime.port}", folder) as daemon:
            yield folder, daemon, daemon.endpoint


def _look(files: Sequence[Path], witness: Witness, began: float, killed_at: float, folder: Path) -> Left:
    entries, newest, gaps = 0, began, 0
    numbers: set[int] = set()
    is_readable = True
    for path in files:
        recording = Recording(path)
        for entry in recording.entries():
            entries += 1
            newest = max(newest, entry.received)
            if entry.kind is Kind.SAMPLE and entry.key == f"mk/{VEHICLE}/{FRAMES}":
                numbers.add(msgpack.unpackb(entry.payload)["sequence"])
        gaps += recording.report.lost
        is_readable = is_readable and _streams(path) and _recovers(path, folder / "recovered.mcap")
    first = min(numbers, default=0)
    wanted = {number for at, number in witness.frames if at < killed_at - ALLOWED and number >= first}
    return Left(entries, killed_at - newest, len(wanted - numbers), gaps, is_readable)


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
        "gaps": sum(one.gaps for one in results),
        "unreadable": sum(not one.is_readable for one in results),
        "entries": sum(one.entries for one in results),
    }
