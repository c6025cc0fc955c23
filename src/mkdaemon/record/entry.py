"""One thing that was recorded, and what is guaranteed about it.

An entry is exact: `payload`, `attachment`, `key` and `encoding` are the bytes and words that crossed the bus or the
line, and both times come back from a file as they went in. The order of entries is the order in which the recorder took
them. `sequence` counts without a gap where nothing was lost between the recorder's tap and the file.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, NamedTuple

import msgpack
from pydantic import ValidationError

from mkdaemon.stamp import NANOSECONDS, Stamp, nanoseconds, seconds

ROOTS: Final = frozenset({"mk", "replay"})
"""First parts of keys that have a vehicle's name next: values of daemons, and recordings that play."""
HOLDER: Final = "holder"
"""Issuer of a setpoint that is signed with the secret of the lease."""
STRANGER: Final = "stranger"
"""Issuer of any other setpoint."""
SEQUENCES: Final = 1 << 32
"""Number of values after which a sequence number restarts at zero."""


EARLIEST: Final = NANOSECONDS
LATEST: Final = 9_000_000_000 * NANOSECONDS
"""Times that a file can have [ns]: within, between 1970 and 2255, every one comes back as a time that it can have."""


class EntryKind(StrEnum):
    """Kind of an entry."""

    SAMPLE = "sample"
    """A value that was published; marks are samples of `event/mark`."""
    SETPOINT = "setpoint"
    """A setpoint that a client put; `attachment` is its signature."""
    QUERY = "query"
    """A query that arrived; `exchange` joins it to its reply."""
    REPLY = "reply"
    """The answer to a query, a refusal too."""
    PORT_READ = "port_read"
    """Bytes read from the line in one piece."""
    PORT_WRITTEN = "port_written"
    """Bytes given to the line in one piece; `issuer` is what for."""
    PORT_OPENED = "port_opened"
    """The line was opened; the payload is a map of `port` and `baud`."""
    PORT_LOST = "port_lost"
    """The line was lost or closed; the payload is a map of `reason`."""
    IMAGE = "image"
    """A camera's image, kept at the recorder's rate; the payload is a `CameraFrame`."""
    EVENT = "event"
    """An event of the flight core with its answer, or its decision; see `events`."""
    NOTICE = "notice"
    """Other events and decisions of the daemon; see `Notice`."""


class Congestion(StrEnum):
    """Treatment of a sample for which a receiver has no room."""

    DROP = "drop"
    BLOCK = "block"


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service of a sample.

    Attributes:
        congestion: what happens when a receiver is too slow.
        priority: Zenoh's, 1 for real time to 7 for background; 5 is ordinary data.
        express: whether it was sent without waiting for others to fill a packet.
    """

    congestion: Congestion = Congestion.DROP
    priority: int = 5
    express: bool = False


ORDINARY: Final = Qos()
"""How the daemon publishes."""


@dataclass(frozen=True, slots=True)
class TimeBase:
    """Joins a machine's monotonic clock to Unix time, once for a recording.

    A file's times are monotonic time plus `offset_ns`: they never jump, even if the system clock is set.

    Attributes:
        boot: names the monotonic clock, as `Stamp.boot` does.
        offset_ns: Unix time less monotonic time when the recording began [ns].
    """

    boot: str
    offset_ns: int

    @classmethod
    def of(cls, stamp: Stamp) -> TimeBase:
        """Join the two clocks of a stamp."""
        return cls(stamp.boot, nanoseconds(stamp.wall) - nanoseconds(stamp.monotonic))

    def file_time(self, monotonic: float) -> int:
        """A monotonic time as it stands in the file [ns; Unix time]."""
        return nanoseconds(monotonic) + self.offset_ns

    def monotonic(self, file_time: int) -> float:
        """The monotonic time [s] of a time in the file [ns]."""
        return seconds(file_time - self.offset_ns)


class Entry(NamedTuple):
    """One thing that was recorded.

    Attributes:
        kind: what it is.
        key: whole key, `mk/<vehicle>/...`; bytes of the line have `mk/<vehicle>/port`.
        payload: as it crossed the bus or the line. Only the secret of a lease is replaced, in `do/lease`.
        encoding: Zenoh's encoding string, for example `application/msgpack;mk.Attitude.v1`; empty for plain bytes.
        received: when the recorder took it, or the port read or wrote it [s; monotonic clock of `base`].
        published: Unix time of its stamp; of `received` where it carries no stamp [s].
        base: joins `received` to Unix time.
        sequence: counts the entries of this kind and key in a recording; a gap is a loss.
        issuer: what sent bytes are for, as `RawFrame.purpose`; who stamped an image; `HOLDER` or `STRANGER` for a
            setpoint, by its signature; else empty.
        exchange: number of a query, and of its reply; else 0.
        attachment: Zenoh's attachment.
        qos: how it was put.
        source: Zenoh id of the session that a setpoint or query says it comes from, `local` for the Unix socket; empty
            where it says none. It is not checked: only a signature proves a sender.
    """

    kind: EntryKind
    key: str
    payload: bytes
    encoding: str
    received: float
    published: float
    base: TimeBase
    sequence: int
    issuer: str = ""
    exchange: int = 0
    attachment: bytes = b""
    qos: Qos = ORDINARY
    source: str = ""

    @property
    def vehicle(self) -> str:
        """Whose it is; empty for a key outside `mk/` and `replay/`."""
        root, _, rest = self.key.partition("/")
        return rest.partition("/")[0] if root in ROOTS else ""

    @property
    def suffix(self) -> str:
        """The key without `mk/<vehicle>/`."""
        return self.key.partition("/")[2].partition("/")[2]

    @property
    def stamp(self) -> Stamp:
        """The stamp the payload carries; where it carries none, the moment it was taken."""
        carried = self.carried_stamp
        return carried or Stamp(monotonic=self.received, wall=self.published, boot=self.base.boot)

    @property
    def carried_stamp(self) -> Stamp | None:
        """The stamp the payload carries; None where it carries none."""
        if "msgpack" not in self.encoding:
            return None
        try:
            return Stamp.model_validate(unpacked(self.payload).get("stamp"))
        except ValidationError:
            return None


_ONLY_TEXT: Final = frozenset({str})


def unpacked(payload: bytes) -> dict[str, Any]:
    """The content of a payload; empty if it is not a map with names."""
    try:
        found = msgpack.unpackb(payload, strict_map_key=False)
    except (ValueError, TypeError, RecursionError, msgpack.exceptions.UnpackException):
        return {}
    return found if isinstance(found, dict) and _ONLY_TEXT.issuperset(map(type, found)) else {}


NOTICES: Final = "notice/"
"""Keys of notices begin so, behind `mk/<vehicle>/`."""


class Notice(StrEnum):
    """Subject of a notice; its payload is a msgpack map, or empty."""

    LAYOUTS = "layouts"
    """By which layouts frames are decoded from now on: `layouts`, rows of board, command letter and layout."""
    IMAGE_SEEN = "image_seen"
    """An image was looked at: `camera`, `sequence`, `attitude`, the time of the newest attitude known by then [s]."""
    SETPOINT_REFUSED = "setpoint_refused"
    """The setpoint before it was refused: `key` without `mk/<vehicle>/`, `sequence` of its entry, `token`, `reason`."""
    STOP = "stop"
    """The daemon was asked to end in order."""

    @property
    def suffix(self) -> str:
        """The key without `mk/<vehicle>/`."""
        return NOTICES + self.value

    @classmethod
    def of(cls, entry: Entry) -> Notice | None:
        """What an entry is about; None where it is no notice of these."""
        word = entry.suffix.removeprefix(NOTICES)
        return cls(word) if entry.kind is EntryKind.NOTICE and word in set(cls) else None
