"""How fast entries are made, written and read, beside a plain loop with the `mcap` library's own writer."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from timeit import repeat
from typing import Any, Final

import numpy as np
from mcap.writer import Writer

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.bus.schema import schema_json
from mkdaemon.clock import Clock
from mkdaemon.record.entry import Entry, EntryKind, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.reader import Recording
from mkdaemon.record.tap import Tap
from mkdaemon.record.view import JsonView
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.state import Attitude, Battery
from mkdaemon.telemetry.traffic import RawFrame

A_SECOND: Final = 1000
"""Entries between two flushes: a second of a busy daemon."""
REPEATS: Final = 3
"""Each way is measured so often; the best counts, for other programs only make it longer."""


def measure(count: int) -> dict[str, Any]:
    """Figures for so many entries.

    Args:
        count: how many.
    """
    values = list(made_values(count))
    entries = [_entry(number, suffix, payload, encoding) for number, (suffix, payload, encoding) in enumerate(values)]
    content, with_json = _written(entries), _written(entries, JsonView(schema_json))
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "a.mcap"
        path.write_bytes(content)
        works: dict[str, Callable[[], object]] = {
            "tap_us": lambda: _tap(values),
            "write_us": lambda: _written(entries),
            "write_json_us": lambda: _written(entries, JsonView(schema_json)),
            "plain_mcap_us": lambda: _write_plain(entries),
            "read_us": lambda: sum(1 for _ in Recording(path).entries()),
        }
        # Garbage is collected as it is in the daemon.
        best = {
            name: min(repeat(work, "import gc; gc.enable()", number=1, repeat=REPEATS)) for name, work in works.items()
        }
    return {
        "entries": count,
        **{name: 1e6 * seconds / count for name, seconds in best.items()},
        "bytes_per_entry": len(content) / count,
        "bytes_per_entry_json": len(with_json) / count,
        "payload_bytes_per_entry": sum(len(entry.payload) for entry in entries) / count,
    }


def made_values(count: int) -> Iterator[tuple[str, bytes, str]]:
    """What a daemon publishes: frames, and what they say."""
    rng = np.random.default_rng(1)
    for number in range(count):
        stamp = Stamp(monotonic=1000.0 + number / A_SECOND, wall=1.79e9 + number / A_SECOND, boot="0123abcd")
        match number % 3:
            case 0:
                value: Any = RawFrame(stamp=stamp, sequence=number, raw=rng.bytes(88))
                yield "raw/rx", encode(value), encoding_of(RawFrame)
            case 1:
                roll, pitch, yaw = rng.normal(size=3).tolist()
                value = Attitude(
                    stamp=stamp, source="nc/attitude", quaternion=(1, 0, 0, 0), roll=roll, pitch=pitch, yaw=yaw
                )
                yield "state/attitude", encode(value), encoding_of(Attitude)
            case _:
                value = Battery(
                    stamp=stamp, source="nc/osd", voltage=11.4, current=2.5, used_mah=130.0 + number, is_low=False
                )
                yield "state/battery", encode(value), encoding_of(Battery)


BASE: Final = TimeBase("0123abcd", 1_790_000_000 * 10**9)
SESSION: Final = Session("blackbox", "lab-20260101T000000Z", 0, "lab", "here", BASE.boot, BASE.offset_ns, "mk1")


def _entry(number: int, suffix: str, payload: bytes, encoding: str) -> Entry:
    at = 1000.0 + number / A_SECOND
    return Entry(EntryKind.SAMPLE, f"mk/mk1/{suffix}", payload, encoding, at, 1.79e9 + at, BASE, number // 3 + 1)


def _written(entries: list[Entry], view: JsonView | None = None) -> bytes:
    output = io.BytesIO()
    writer = RecordingWriter(output, SESSION, view)
    for number, entry in enumerate(entries, 1):
        writer.add(entry)
        if number % A_SECOND == 0:
            writer.flush()
    writer.finish()
    return output.getvalue()


def _write_plain(entries: list[Entry]) -> None:
    """The same payloads through the library's own writer, without times, numbers and metadata of ours."""
    writer = Writer(io.BytesIO())
    writer.start()
    channels: dict[str, int] = {}
    for number, entry in enumerate(entries, 1):
        channel = channels.get(entry.key)
        if channel is None:
            channel = channels[entry.key] = writer.register_channel(entry.key, "msgpack", 0)
        at = int(entry.received * 1e9)
        writer.add_message(channel, at, entry.payload, at, number)
        if number % A_SECOND == 0:
            writer.flush()  # type: ignore[no-untyped-call]
    writer.finish()  # type: ignore[no-untyped-call]


def _tap(values: list[tuple[str, bytes, str]]) -> None:
    """What a published value costs on the loop: an entry, and its way into the queue."""
    clock = Clock()
    stamp = clock.stamp()
    queue = EntryQueue(10**12)
    tap = Tap(queue, clock, "mk1", TimeBase.of(stamp))
    for suffix, payload, encoding in values:
        tap.sample(suffix, payload, encoding, stamp)
