"""Signatures with one shared key; a frame that was heard once is not taken again, after a restart neither.

The newest time of every stream is kept in a file, a little ahead of what was heard, so it is written seldom and holds
after a crash as well: the next run takes nothing up to it. Source: https://mavlink.io/en/guide/message_signing.html
("Timestamp Handling").
"""

from __future__ import annotations

import hashlib
import hmac
import json
from pathlib import Path
from typing import Final

import structlog

from mkdaemon.files import write_whole

AHEAD: Final = 3 * 100_000
"""How far the file is ahead of the newest time [10 us]; a stream waits at most this time after a quick restart."""
SIGNATURE: Final = 13
"""Bytes of a signature: link, time, and six of a hash."""
_EPOCH: Final = 1_420_070_400
"""Signatures count time from 2015-01-01 00:00 UTC [s; Unix time]."""
_LATE: Final = 60 * 100_000
"""Largest lag of a new stream behind our clock [10 us]."""
_MOST_STREAMS: Final = 64
"""Signed streams (link, system, component) that are remembered."""
_LARGEST: Final = 65_536
Stream = tuple[int, int, int]
"""Link, system, component."""
_log: Final = structlog.get_logger("gateway.mavlink")


def signing_time(wall: float) -> int:
    """A system time as signatures count it [10 us].

    Args:
        wall: Unix time [s].
    """
    return int((wall - _EPOCH) * 100_000)


class Signing:
    """Makes and checks signatures.

    Attributes:
        key: 32 bytes.
    """

    def __init__(self, key: bytes, path: Path | None = None) -> None:
        """Read what the run before has left.

        Args:
            key: 32 bytes.
            path: file of the newest times; None to remember nothing beyond this run.
        """
        self.key = key
        self._path = path
        self._kept = _read(path)
        self._newest = dict(self._kept)

    def is_right(self, frame: bytes, wall: float) -> bool:
        """Whether a signed frame of MAVLink 2 has a right signature, and is newer than the last of its stream.

        Args:
            frame: with its signature.
            wall: Unix time [s].
        """
        made = hashlib.sha256(self.key + frame[:-6]).digest()[:6]
        if not hmac.compare_digest(made, frame[-6:]):
            return False
        stream = (frame[-SIGNATURE], frame[5], frame[6])
        stamp = int.from_bytes(frame[-12:-6], "little")
        newest = self._newest.get(stream)
        if newest is None:
            if len(self._newest) >= _MOST_STREAMS or stamp + _LATE < signing_time(wall):
                return False
        elif stamp <= newest:
            return False
        self._newest[stream] = stamp
        if self._path is not None and stamp > self._kept.get(stream, -1):
            self._kept[stream] = stamp + AHEAD
            self._write(self._path)
        return True

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


def key_from(text: str) -> bytes:
    """The key that a text stands for: 64 hexadecimal digits as they are, else the SHA-256 of a passphrase.

    Ground stations make their key of a passphrase in the same way.
    """
    word = text.strip()
    try:
        key = bytes.fromhex(word)
    except ValueError:
        key = b""
    return key if len(key) == 32 else hashlib.sha256(word.encode()).digest()
