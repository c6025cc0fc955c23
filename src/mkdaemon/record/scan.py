"""The records of an MCAP file, whole or damaged: what is broken is named and stepped over, never raised.

A chunk proves itself by its checksum; other records only by their opcode, and by ending where another one begins. Where
that fails, the next chunk is looked for byte by byte. Channels and metadata are read without trust too.
"""

from __future__ import annotations

import errno
import os
import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import BinaryIO, Final

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from mkdaemon.record.layout import MAGIC


@dataclass(frozen=True, slots=True)
class ScannedChannel:
    """A channel of a file.

    Attributes:
        number: its id in the file.
        topic: its name.
        message_encoding: how its messages are stored.
        metadata: what else the writer said.
    """

    number: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


class _Cut(Exception):  # noqa: N818  # never leaves this module
    """The content ends too early."""


class _Fields:
    def __init__(self, content: bytes) -> None:
        self._content = content
        self._at = 0

    def number(self, size: int) -> int:
        return int.from_bytes(self._take(size), "little")

    def text(self) -> str:
        return self._take(self.number(4)).decode()

    def map(self) -> dict[str, str]:
        length = self.number(4)
        end = self._at + length
        found = {}
        while self._at < end:
            name = self.text()
            found[name] = self.text()
        if self._at != end:
            raise _Cut
        return found

    def _take(self, size: int) -> bytes:
        part = self._content[self._at : self._at + size]
        if len(part) < size:
            raise _Cut
        self._at += size
        return part


def read_channel(content: bytes) -> ScannedChannel | None:
    """A channel from a record's content; None where it is none."""
    try:
        fields = _Fields(content)
        number = fields.number(2)
        fields.number(2)
        return ScannedChannel(number, fields.text(), fields.text(), fields.map())
    except (_Cut, UnicodeDecodeError):
        return None


def read_metadata(content: bytes) -> tuple[str, dict[str, str]] | None:
    """Name and map of a metadata record; None where it is none."""
    try:
        fields = _Fields(content)
        return fields.text(), fields.map()
    except (_Cut, UnicodeDecodeError):
        return None


MOST_CHUNK_BYTES: Final = 1 << 26
"""Largest chunk read [bytes]; ours hold 1 MB and a message, some programs put a whole file into one."""
_MISFIT: Final = f"it is cut off, or longer than {MOST_CHUNK_BYTES >> 20} MiB (mcap compress writes small ones)"
_PRIVATE: Final = 0x80
"""From this opcode on records belong to applications, and are stepped over. Source: MCAP specification, "Opcodes"."""
_MESSAGE: Final = struct.Struct("<HIQQ")
_MOST_LOOSE_BYTES: Final = 1 << 20
"""Messages outside of chunks are read in runs of this length [bytes]."""
MOST_SUMMARY_BYTES: Final = 1 << 26
"""Of any other record [bytes]."""
EXPANSION: Final = 200
FREE_BYTES: Final = 1 << 28
"""Chunks may expand to `EXPANSION` times the bytes of the file before them, plus this [bytes]; ours expand 20 times."""
PATIENCE: Final = 4
"""The search for the next chunk may read this multiple of the file's bytes, plus `FREE_BYTES`."""
_LONGEST_NAME: Final = 8
"""Of a compression [bytes]."""
_BLOCK: Final = 1 << 20
_HEAD: Final = struct.Struct("<BQ")
_CHUNK: Final = struct.Struct("<QQQII")
_CHUNK_START: Final = re.compile(rb"\x06[\x00-\xff]{4}\x00{4}")
_OPCODES: Final = frozenset(int(opcode) for opcode in Opcode)


@dataclass(frozen=True, slots=True)
class Damage:
    """A part of a file that cannot be read.

    Attributes:
        offset: where it begins [bytes].
        length: how long it is [bytes].
        reason: what is wrong with it.
    """

    offset: int
    length: int
    reason: str


@dataclass(frozen=True)
class ScannedChunk:
    """A chunk that is right.

    Attributes:
        offset: where its record begins in the file [bytes].
        first: earliest time in it [ns].
        last: latest time in it [ns].
        stored: its records, compressed or not.
        compression: how.
        size: of its records [bytes].
        checksum: of its records; 0 where there is none.
    """

    offset: int
    first: int
    last: int
    stored: bytes
    compression: str
    size: int
    checksum: int

    def fault(self) -> str:
        """What is wrong with it; empty where it is right."""
        try:
            self.content()
        except ValueError as error:
            return str(error)
        return ""

    def content(self) -> bytes:
        """Its records.

        Raises:
            ValueError: it is damaged, or compressed in an unknown way.
        """
        return self._content

    @cached_property
    def _content(self) -> bytes:
        match self.compression:
            case "":
                content = self.stored
            case "zstd":
                content = _decompress(self.stored, self.size)
            case "lz4":
                content = _decompress_lz4(self.stored, self.size)
            case _:
                msg = f"compression {self.compression!r} is not supported; convert it: mcap compress --compression zstd"
                raise ValueError(msg)
        if len(content) != self.size:
            msg = "another length than it says"
            raise ValueError(msg)
        if self.checksum and zlib.crc32(content) != self.checksum:
            msg = "its checksum is wrong"
            raise ValueError(msg)
        return content


@dataclass(frozen=True, slots=True)
class Record:
    """A record outside of chunks.

    Attributes:
        opcode: MCAP's.
        content: without opcode and length.
    """

    opcode: int
    content: bytes


class Scanner:
    """Walks through a file once.

    Attributes:
        damages: what could not be read.
        is_complete: whether the file ends as a finished file does; known at the end.
    """

    def __init__(self, file: BinaryIO, size: int) -> None:
        """Begin at the start of a file.

        Args:
            file: open for reading.
            size: its length when it was opened; what is appended later is not read.
        """
        self.damages: list[Damage] = []
        self.is_complete = False
        self._file = file
        self._size = size
        self._expanded = 0
        self._tried = 0

    def records(self, start: int = 0) -> Iterator[Record | ScannedChunk]:
        """All records and chunks that are right, in order.

        Args:
            start: offset of a chunk to begin at, which was found right before; 0 for the beginning.
        """
        # From `unproven` on a chunk is looked for when no record begins where one should.
        at = unproven = start or len(MAGIC)
        if not start and self._read(0, len(MAGIC)) != MAGIC:
            at = unproven = self._resume(0, 0, "its beginning is damaged, or it is not an MCAP file")
        while at < self._size:
            record = self._record_at(at)
            if isinstance(record, str):
                at = unproven = self._resume(unproven, at, record)
                continue
            end = at + _HEAD.size + len(record.content)
            if record.opcode == Opcode.MESSAGE:
                loose = self._loose(at, record)
                end = unproven = at + len(loose.stored)
                self._file.seek(end)
                yield loose
            elif record.opcode == Opcode.CHUNK:
                chunk = read_chunk(record.content, at)
                fault = _MISFIT if chunk is None else self._fault(chunk, end)
                if chunk is None or fault:
                    self.damages.append(Damage(at, end - at, f"a chunk is damaged: {fault}"))
                    unproven = at + 1  # its length may be wrong as well
                else:
                    yield chunk
                    unproven = end
            elif record.opcode == Opcode.FOOTER:
                self.is_complete = self._read(end, len(MAGIC) + 1) == MAGIC
                if not self.is_complete:
                    self.damages.append(Damage(end, self._size - end, "its end is damaged"))
                return
            else:
                yield record
            at = end
        if not self.damages:
            self.damages.append(Damage(self._size, 0, "it ends without an index"))

    def _loose(self, at: int, record: Record) -> ScannedChunk:
        """The messages that begin somewhere outside of a chunk, one after the other, as a chunk without a checksum."""
        parts, times, size = list[bytes](), list[int](), 0
        found: Record | str = record
        while isinstance(found, Record) and found.opcode == Opcode.MESSAGE and size < _MOST_LOOSE_BYTES:
            parts += [_HEAD.pack(found.opcode, len(found.content)), found.content]
            times.append(_MESSAGE.unpack_from(found.content)[2])
            size += _HEAD.size + len(found.content)
            found = self._record_at(at + size) if at + size < self._size else ""
        return ScannedChunk(at, min(times), max(times), b"".join(parts), "", size, 0)

    def _fault(self, chunk: ScannedChunk, end: int) -> str:
        """What is wrong with a chunk that ends somewhere; empty where it is right."""
        if self._expanded + chunk.size > FREE_BYTES + EXPANSION * end:
            return "it holds more than a file of this size can"
        self._expanded += chunk.size
        return chunk.fault()

    def _record_at(self, at: int) -> Record | str:
        """The record that begins somewhere; what is wrong where none does."""
        head = self._read(at, _HEAD.size)
        if len(head) < _HEAD.size:
            return "it is cut off"
        opcode, length = _HEAD.unpack(head)
        is_known = opcode in _OPCODES or opcode >= _PRIVATE
        if not is_known or length > (MOST_CHUNK_BYTES if opcode == Opcode.CHUNK else MOST_SUMMARY_BYTES):
            return "no record begins here"
        if at + _HEAD.size + length > self._size:
            return "it is cut off"
        record = Record(opcode, self._read(at + _HEAD.size, length))
        return record if _is_plausible(record) else "no record begins here"

    def _resume(self, start: int, seen: int, reason: str) -> int:
        """Where the next chunk that is right begins; the end of the file where the rest is lost.

        Args:
            start: from where to look.
            seen: where the damage was noticed.
            reason: what is wrong.
        """
        found = self._next_chunk(start)
        begin = start if found < seen else seen
        self.damages.append(Damage(begin, found - begin, reason))
        return found

    def _next_chunk(self, start: int) -> int:
        at = self._next_data(start)
        while at < self._size:
            for found in _CHUNK_START.finditer(self._read(at, _BLOCK + _HEAD.size)):
                if not self._may_be_chunk(at + found.start()):
                    continue
                record = self._record_at(at + found.start())
                chunk = read_chunk(record.content) if isinstance(record, Record) else None
                if chunk is None:
                    continue
                self._tried += len(chunk.stored) + chunk.size
                if self._tried > FREE_BYTES + PATIENCE * self._size:
                    return self._size
                if chunk.checksum and not chunk.fault():
                    return at + found.start()
            at = self._next_data(at + _BLOCK)
        return self._size

    def _next_data(self, at: int) -> int:
        """Where the next bytes are that were ever written; a file may have large holes."""
        try:
            return self._file.seek(at, os.SEEK_DATA)
        except OSError as error:
            return self._size if error.errno == errno.ENXIO else at
        except ValueError:  # a file in memory
            return at

    def _may_be_chunk(self, at: int) -> bool:
        """Whether the first bytes are those of a chunk: damage has many places like it, and a chunk may be long."""
        head = self._read(at, _HEAD.size + _CHUNK.size + _LONGEST_NAME + 8)
        if len(head) < _HEAD.size + _CHUNK.size:
            return False
        (*_, name) = _CHUNK.unpack_from(head, _HEAD.size)
        stored = _HEAD.size + _CHUNK.size + name
        if name > _LONGEST_NAME or len(head) < stored + 8:
            return False
        (length,), (_, whole) = struct.unpack_from("<Q", head, stored), _HEAD.unpack_from(head)
        return bool(length == whole - _CHUNK.size - name - 8)

    def _read(self, at: int, length: int) -> bytes:
        self._file.seek(at)
        return self._file.read(max(min(length, self._size - at), 0))


def read_chunk(content: bytes, offset: int = 0) -> ScannedChunk | None:
    """A chunk from the content of its record, which begins at an offset of the file; None where it is none."""
    try:
        first, last, size, checksum, name = _CHUNK.unpack_from(content)
        at = _CHUNK.size
        compression = content[at : at + name].decode()
        (length,) = struct.unpack_from("<Q", content, at + name)
    except (struct.error, UnicodeDecodeError):
        return None
    stored = content[at + name + 8 :]
    if len(stored) != length or size > MOST_CHUNK_BYTES:
        return None
    return ScannedChunk(offset, first, last, stored, compression, size, checksum)


def records_in(content: bytes) -> Iterator[Record]:
    """The records of a chunk.

    Raises:
        ValueError: it ends inside a record.
    """
    for opcode, begin, end in places_in(content):
        yield Record(opcode, content[begin:end])


def places_in(content: bytes) -> Iterator[tuple[int, int, int]]:
    """The records of a chunk: opcode, and where the content begins and ends. Nothing is copied.

    Raises:
        ValueError: it ends inside a record.
    """
    at, size, head, unpack = 0, len(content), _HEAD.size, _HEAD.unpack_from
    while at < size:
        begin = at + head
        if begin <= size:
            opcode, length = unpack(content, at)
            at = begin + length
        if begin > size or at > size:
            msg = "it ends inside a record"
            raise ValueError(msg)
        yield opcode, begin, at


def _is_plausible(record: Record) -> bool:
    """Whether a record's length fits what it is: one damaged byte must not make a chunk pass as another record."""
    length = len(record.content)
    match record.opcode:
        case Opcode.FOOTER:
            return length == 20
        case Opcode.DATA_END:
            return length == 4
        case Opcode.SUMMARY_OFFSET:
            return length == 17
        case Opcode.MESSAGE_INDEX:
            return length >= 6 and int.from_bytes(record.content[2:6], "little") == length - 6
        case Opcode.CHANNEL:
            return read_channel(record.content) is not None
        case Opcode.MESSAGE:
            return length >= _MESSAGE.size
        case opcode if opcode >= _PRIVATE:
            return read_chunk(record.content) is None  # a chunk whose opcode was damaged
        case _:
            return True


def _decompress(stored: bytes, size: int) -> bytes:
    try:
        if zstandard.frame_content_size(stored) not in (-1, size):  # -1: the frame does not say
            msg = "another length than it says"
            raise ValueError(msg)
        return zstandard.ZstdDecompressor().decompress(stored, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def _decompress_lz4(stored: bytes, size: int) -> bytes:
    try:
        content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(stored, max_length=size + 1)
        return content
    except RuntimeError as error:
        raise ValueError(str(error)) from error
