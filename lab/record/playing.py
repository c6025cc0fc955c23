"""A flight that is recorded on the ground, played, and recorded again: the same bytes in the same order, and how late.

Real programs: `mkdaemon run`, `mkctl log record` and `mkctl log play`. Setpoints and requests are never played; what
they did is in the values that are. Beside the player a thread sleeps and says how late it is woken.
"""

from __future__ import annotations

import asyncio
import json
import signal
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from lab.record.cost import LINK
from lab.rigs.flown import flown, observed
from lab.rigs.pilot import Pilot
from lab.rigs.processes import MKCTL, Program
from lab.rigs.sleeper import Sleeper
from lab.rigs.waiting import wait_until
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.link.session.evidence import percentile
from mkdaemon.record.entry import Entry, EntryKind
from mkdaemon.record.reader import Recording

SHOWN: Final = "show"
"""Vehicle as which it is played."""
GONE: Final = 1.0
"""After the player's end, before its recorder is told to end [s]."""


async def measure(seconds: float) -> dict[str, Any]:
    """Fly by sticks for so long, with marks between, play the recording and compare what arrives.

    Args:
        seconds: of the flight.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        await _fly(folder, seconds)
        first = _only_file(folder / "flown")
        said = await _play(folder, first)
        return {**compare(first, _only_file(folder / "played")), **said}


async def _fly(folder: Path, seconds: float) -> None:
    async with flown(observed(1), folder=folder, link=LINK) as one, Pilot(one.client, "pilot") as pilot:
        words = ("log", "record", "--folder", f"{folder}/flown", "--connect", one.daemon.endpoint, "--json")
        recorder = await Program.start(*MKCTL, *words)
        await wait_until(lambda: any((folder / "flown").glob("*.mcap")))
        await pilot.engage(lambda: one.simulation.is_controlled)
        for number in range(4):
            pilot.sticks["pitch"] = 5.0 * (number % 2)
            await one.client.command("do", "mark", {"text": f"part {number}"})
            await asyncio.sleep(seconds / 4)
        await recorder.end(signal.SIGINT)


async def _play(folder: Path, first: Path) -> dict[str, Any]:
    """What the player and the sleeper said of themselves."""
    with reserved_endpoint() as endpoint:
        words = ("log", "play", str(first), "--as", SHOWN, "--listen", endpoint, "--wait", "30", "--json")
        recorder = await Program.start(
            *MKCTL, "log", "record", "--folder", f"{folder}/played", "--connect", endpoint, "--json"
        )
        player = await Program.start(*MKCTL, *words)
        with Sleeper() as sleeper:
            _, said = await player.output()
        await asyncio.sleep(GONE)
        await recorder.end(signal.SIGINT)
        played = json.loads(said)
    return {
        "put": played["sent"],
        "not_put": played["missing"],
        "put_late_p99_ms": 1e3 * played["late_p99_s"],
        "sleeper_p99_ms": sleeper.percentile(99.0),
    }


def _only_file(folder: Path) -> Path:
    (path,) = folder.glob("*.mcap")
    return path


def _values(path: Path) -> list[Entry]:
    return list(Recording(path).entries(lambda facts: facts.kind is EntryKind.SAMPLE))


def compare(first: Path, second: Path) -> dict[str, Any]:
    """How far two recordings of the same values agree; the second one's vehicle has another name."""
    flown, played = _values(first), _values(second)
    keys = sorted({entry.suffix for entry in flown} | {entry.suffix for entry in played})
    pairs = list(zip(flown, played, strict=False))
    late = [new.received - old.received for old, new in pairs]
    ordinary = median(late) if late else 0.0
    off = sorted(abs(one - ordinary) for one in late)
    span = flown[-1].received - flown[0].received
    return {
        "values": len(flown),
        "values_played": len(played),
        "keys": len(keys),
        "values_per_s": len(flown) / span,
        "keys_that_differ": [key for key in keys if _of_key(flown, key) != _of_key(played, key)],
        "out_of_order": sum(old.suffix != new.suffix for old, new in pairs),
        "off_p50_ms": 1e3 * (percentile(off, 0.5) or 0.0),
        "off_p99_ms": 1e3 * (percentile(off, 0.99) or 0.0),
        "setpoints_played": sum(1 for _ in Recording(second).entries(lambda facts: facts.kind is EntryKind.SETPOINT)),
    }


def _of_key(entries: Sequence[Entry], suffix: str) -> list[tuple[bytes, str]]:
    return [(entry.payload, entry.encoding) for entry in entries if entry.suffix == suffix]
