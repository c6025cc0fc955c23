"""Newest signing time of every stream, kept in a file: what was recorded before a restart is not taken after it.

The file holds a time a little ahead of the newest one, so it is written seldom and holds after a crash as well: the
next run takes nothing up to it. Source: https://mavlink.io/en/guide/message_signing.html ("Timestamp Handling").
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import structlog

from mkdaemon.files import write_whole

AHEAD: Final = 3 * 100_000
"""How far the file is ahead of the newest time [10 us]; a stream waits at most this time after a quick restart."""
_LARGEST: Final = 65_536
Stream = tuple[int, int, int]
"""Link, system, component."""
_log: Final = structlog.get_logger("gateway.mavlink")


class SigningTimes:
    """The newest signing time of each stream [10 us since 2015]."""

    def __init__(self, path: Path | None = None) -> None:
        """Read what the run before has left.

        Args:
            path: of the file; None to remember nothing beyond this run.
        """
        self._path = path
        self._kept = _read(path)
        self._newest = dict(self._kept)

    def __len__(self) -> int:
        return len(self._newest)

    def get(self, stream: Stream) -> int | None:
        """Newest time of a stream; None where it was never heard."""
        return self._newest.get(stream)

    def put(self, stream: Stream, stamp: int) -> None:
        """Note a time that is newer than the newest."""
        self._newest[stream] = stamp
        if self._path is not None and stamp > self._kept.get(stream, -1):
            self._kept[stream] = stamp + AHEAD
            self._write(self._path)

    def _write(self, path: Path) -> None:
        rows = [[*stream, stamp] for stream, stamp in self._kept.items()]
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, json.dumps(rows), overwrite=True)
        except OSError as error:
            _log.warning("signing times are not kept: a recorded stream may be taken after a restart", error=str(error))
            self._path = None


def _read(path: Path | None) -> dict[Stream, int]:
    """What a file holds; nothing where there is none."""
    if path is None or not path.exists():
        return {}
    try:
        if path.stat().st_size > _LARGEST:
            raise ValueError("too large")
        return {(int(a), int(b), int(c)): int(stamp) for a, b, c, stamp in json.loads(path.read_text(encoding="ascii"))}
    except (OSError, ValueError, TypeError) as error:
        _log.warning("signing times of the run before cannot be read", file=str(path), error=str(error))
        return {}
