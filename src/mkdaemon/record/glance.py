"""What can be told of a recording without reading it."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode

from mkdaemon.errors import MkError
from mkdaemon.reading import open_regular
from mkdaemon.record.entry import NANOSECONDS
from mkdaemon.record.layout import MAGIC, Session
from mkdaemon.record.reader import Recording
from mkdaemon.record.scan import records_in

_FOOTER: Final = struct.Struct("<BQQQI")
_STATISTICS: Final = struct.Struct("<QHIIIIQQ")
_LONGEST_SUMMARY: Final = 1 << 26
"""A longer index is taken for damage [bytes]."""


@dataclass(frozen=True, slots=True)
class Glance:
    """What the beginning and the end of a file say.

    Attributes:
        path: the file.
        size: [bytes].
        session: None where it says nothing about itself.
        first: time of the earliest entry [ns]; None where the file was not finished.
        last: time of the latest entry [ns]; None where the file was not finished.
    """

    path: Path
    size: int
    session: Session | None
    first: int | None = None
    last: int | None = None

    @property
    def is_finished(self) -> bool:
        """Whether it has an index."""
        return self.first is not None

    @property
    def duration(self) -> float | None:
        """From the earliest to the latest entry [s]."""
        return None if self.first is None or self.last is None else (self.last - self.first) / NANOSECONDS


def glance(path: Path) -> Glance:
    """Look at a file.

    Raises:
        MkError: it cannot be opened.
    """
    session = Recording(path).read_session()
    try:
        with open_regular(path) as file:
            size = file.seek(0, 2)
            times = _times(file, size)
    except OSError as error:
        msg = f"{path}: cannot be read ({error.strerror})"
        raise MkError(msg) from error
    return Glance(path, size, session) if times is None else Glance(path, size, session, *times)


def _times(file: BinaryIO, size: int) -> tuple[int, int] | None:
    """First and last time from the index; None where there is none."""
    end = size - len(MAGIC) - _FOOTER.size
    if end < 0:
        return None
    file.seek(end)
    opcode, length, start, _, _ = _FOOTER.unpack(file.read(_FOOTER.size))
    if file.read() != MAGIC or opcode != Opcode.FOOTER or length != 20 or not end - _LONGEST_SUMMARY < start <= end:
        return None
    file.seek(start)
    try:
        for record in records_in(file.read(end - start)):
            if record.opcode == Opcode.STATISTICS and len(record.content) >= _STATISTICS.size:
                *_, first, last = _STATISTICS.unpack_from(record.content)
                return first, last
    except ValueError:
        pass
    return None
