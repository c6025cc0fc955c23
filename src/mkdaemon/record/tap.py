"""Makes entries of what passes inside the daemon, at the moment it passes; returns at once and never raises."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from secrets import token_bytes
from types import MappingProxyType
from typing import Any, Final

import msgpack

from mkdaemon.clock import Clock
from mkdaemon.control.events import Event, Reply
from mkdaemon.protocol.decoder import Layouts
from mkdaemon.record.entry import HOLDER, SEQUENCES, STRANGER, Entry, EntryKind, Notice, TimeBase
from mkdaemon.record.events import DERIVED, TICK, pack_event, suffix_of
from mkdaemon.record.queue import EntryQueue
from mkdaemon.stamp import Stamp

SECRET: Final = "secret"
SECRETS: Final = (SECRET, "setpoint_root")
"""What only the holder of a lease receives."""
"""Field that is never recorded: its owner can fly the aircraft."""
HIDDEN: Final = "..."
PORT: Final = "port"
"""Suffix of the key that bytes of the line have."""

NOTHING: Final[Mapping[str, object]] = MappingProxyType({})
MakeImage = Callable[[], tuple[bytes, str] | None]


class Tap:
    """Entries of one vehicle, in the order in which things passed. Each kind and key is for one thread at a time."""

    def __init__(self, queue: EntryQueue, clock: Clock, vehicle: str, base: TimeBase) -> None:
        """Put entries into a queue.

        Args:
            queue: takes them.
            clock: of the daemon.
            vehicle: its name.
            base: of the recording.
        """
        self._queue = queue
        self._clock = clock
        self._root = f"mk/{vehicle}/"
        self._base = base
        self._sequences: dict[tuple[EntryKind, str], int] = {}
        self._key = token_bytes(16)

    def sample(self, suffix: str, payload: bytes, encoding: str, stamp: Stamp | None) -> None:
        """Take a value that is published."""
        self._take(EntryKind.SAMPLE, suffix, payload, encoding, self._clock.now(), stamp)

    def setpoint(
        self, suffix: str, payload: bytes, encoding: str, signature: bytes, *, at: float, source: str, is_holder: bool
    ) -> None:
        """Take a setpoint that arrived; see `mkdaemon.bus.recording.BusRecorder`."""
        issuer = HOLDER if is_holder else STRANGER
        self._take(
            EntryKind.SETPOINT, suffix, payload, encoding, at, issuer=issuer, attachment=signature, source=source
        )

    def setpoint_refused(self, suffix: str, token: str, reason: str) -> None:
        """Note that the last setpoint of a key was refused."""
        sequence = self._sequences.get((EntryKind.SETPOINT, suffix), 0)
        fields = {"key": suffix, "sequence": sequence, "token": token, "reason": reason}
        self.notice(Notice.SETPOINT_REFUSED, fields=fields)

    def query(self, suffix: str, payload: bytes, exchange: int, source: str) -> None:
        """Take a query that arrived."""
        hidden, at = hide_secrets(payload), self._clock.now()
        self._take(EntryKind.QUERY, suffix, hidden, "application/msgpack", at, exchange=exchange, source=source)

    def reply(self, suffix: str, payload: bytes, encoding: str, exchange: int) -> None:
        """Take the answer to a query."""
        hidden = hide_secrets(payload)
        self._take(EntryKind.REPLY, suffix, hidden, encoding, self._clock.now(), exchange=exchange)

    def fed(self, event: Event, at: float, reply: Reply | None) -> None:
        """Take an event of the flight core and its answer; events that follow from bytes are left out."""
        if type(event) not in DERIVED:
            payload = pack_event(event, reply, self._key)
            self._take(EntryKind.EVENT, suffix_of(event), payload, "application/msgpack", at)

    def ticked(self, at: float, slept: float) -> None:
        """Take that the flight core decided."""
        payload = msgpack.packb({"slept": slept}) if slept else b""
        self._take(EntryKind.EVENT, TICK, payload, "application/msgpack" if payload else "", at)

    def port_read(self, data: bytes, at: float) -> None:
        """Take bytes that were read from the line."""
        self._take(EntryKind.PORT_READ, PORT, data, "", at)

    def port_written(self, data: bytes, at: float, issuer: str) -> None:
        """Take bytes that were given to the line."""
        self._take(EntryKind.PORT_WRITTEN, PORT, data, "", at, issuer=issuer)

    def port_opened(self, port: str, baud: int, at: float) -> None:
        """Note that the line was opened."""
        payload = msgpack.packb({"port": port, "baud": baud})
        self._take(EntryKind.PORT_OPENED, PORT, payload, "application/msgpack", at)

    def port_lost(self, reason: str, at: float) -> None:
        """Note that the line was lost or closed."""
        self._take(EntryKind.PORT_LOST, PORT, msgpack.packb({"reason": reason}), "application/msgpack", at)

    def layouts_changed(self, layouts: Layouts, at: float) -> None:
        """Note by which layouts frames are decoded from now on."""
        rows = [(board.word, letter, layout) for (board, letter), layout in layouts.items()]
        self.notice(Notice.LAYOUTS, at, {"layouts": rows})

    def notice(self, notice: Notice, at: float | None = None, fields: Mapping[str, object] = NOTHING) -> None:
        """Note something from beside the bus and the line; on the loop.

        Args:
            notice: what.
            at: when [s; monotonic]; now if none is given.
            fields: more about it.
        """
        self._put_notice(notice, msgpack.packb(dict(fields)) if fields else b"", at)

    def image_seen(self, camera: str, sequence: int, attitude: float | None) -> None:
        """Note what was known of the attitude when an image was processed; on the vision thread."""
        fields = {"camera": camera, "sequence": sequence, "attitude": attitude}
        self._put_notice(Notice.IMAGE_SEEN, msgpack.packb(fields))

    def image(self, suffix: str, make: MakeImage, stamp: Stamp, stamped_by: str, *, at: float, size: int) -> None:
        """Take an image that is compressed later, on the recorder's thread.

        Args:
            suffix: key without `mk/<vehicle>/`.
            make: returns payload and encoding; None where it cannot be compressed.
            stamp: of the middle of the exposure.
            stamped_by: who knew it.
            at: when the daemon had it [s; monotonic].
            size: what the image takes until then [bytes].
        """
        sequence = self._count(EntryKind.IMAGE, suffix)

        def entry() -> Entry | None:
            made = make()
            if made is None:
                return None
            return Entry(EntryKind.IMAGE, self._root + suffix, *made, at, stamp.wall, self._base, sequence, stamped_by)

        self._queue.defer(entry, size)

    def _put_notice(self, notice: Notice, payload: bytes, at: float | None = None) -> None:
        encoding = "application/msgpack" if payload else ""
        self._take(EntryKind.NOTICE, notice.suffix, payload, encoding, self._clock.now() if at is None else at)

    def _take(
        self,
        kind: EntryKind,
        suffix: str,
        payload: bytes,
        encoding: str,
        at: float,
        stamp: Stamp | None = None,
        issuer: str = "",
        exchange: int = 0,
        attachment: bytes = b"",
        source: str = "",
    ) -> None:
        sequence = self._count(kind, suffix)
        wall = self._clock.wall(at) if stamp is None else stamp.wall
        first = (kind, self._root + suffix, payload, encoding, at, wall, self._base, sequence)
        self._queue.put(Entry(*first, issuer, exchange, attachment, source=source))

    def _count(self, kind: EntryKind, suffix: str) -> int:
        sequence = self._sequences.get((kind, suffix), 0) + 1
        self._sequences[kind, suffix] = sequence % SEQUENCES
        return sequence


def hide_secrets(payload: bytes) -> bytes:
    """A payload without the secrets of a lease; unchanged if it has none."""
    if SECRET.encode() not in payload:
        return payload
    try:
        hidden: bytes = msgpack.packb(_hidden(msgpack.unpackb(payload)))
    except (ValueError, TypeError, RecursionError, msgpack.exceptions.UnpackException):
        return b""  # it has the word and cannot be read: it must not be kept
    return hidden


def _hidden(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: HIDDEN if key in SECRETS and part else _hidden(part) for key, part in value.items()}
    return [_hidden(part) for part in value] if isinstance(value, list) else value
