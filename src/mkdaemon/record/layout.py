"""Channels and metadata of a recording: the format beside MCAP's own records.

A change that old readers would misunderstand gets a new `FORMAT`; a field may be added without.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Final

import msgpack

from mkdaemon.record.entry import EARLIEST, LATEST, Congestion, Entry, EntryKind, Qos, TimeBase
from mkdaemon.stamp import NANOSECONDS

MAGIC: Final = b"\x89MCAP0\r\n"
"""At both ends of every MCAP file."""
LONGEST_KEY: Final = 200
"""Of an entry [characters]; ours have up to 60."""
FORMAT: Final = "1"
PROFILE: Final = "mkdaemon"
SESSION: Final = "mkdaemon.session"
"""Name of the metadata record with the session; repeated, the last one counts."""
VIEW: Final = "view"
"""Set in the metadata of a channel that only repeats another one as JSON, for viewers; no entries."""


@dataclass(frozen=True, slots=True)
class Session:
    """Description of a file by itself.

    Attributes:
        recorder: `blackbox`, `ground`, or the tool that made the file.
        name: of the recording; all its parts have the same.
        part: number of this file in it, from 0.
        program: name and version of what wrote it.
        host: machine it was written on.
        boot: names that machine's monotonic clock.
        offset_ns: see `TimeBase`.
        vehicle: whose recording; empty for several.
        config: the configuration as JSON; empty where there is none.
    """

    recorder: str
    name: str
    part: int
    program: str
    host: str
    boot: str
    offset_ns: int
    vehicle: str = ""
    config: str = ""

    @classmethod
    def begin(cls, recorder: str, name: str, base: TimeBase, *, vehicle: str = "", config: str = "") -> Session:
        """The session of a recording that this program begins on this machine; see the attributes."""
        program = f"mkdaemon {version('mkdaemon')}"
        return cls(recorder, name, 0, program, os.uname().nodename, base.boot, base.offset_ns, vehicle, config)

    @property
    def base(self) -> TimeBase:
        """Time base of what the recorder took itself."""
        return TimeBase(self.boot, self.offset_ns)

    def to_metadata(self) -> dict[str, str]:
        """As metadata of a file."""
        return {
            "format": FORMAT,
            "recorder": self.recorder,
            "name": self.name,
            "part": str(self.part),
            "program": self.program,
            "host": self.host,
            "boot": self.boot,
            "offset_ns": str(self.offset_ns),
            "vehicle": self.vehicle,
            "config": self.config,
        }

    @classmethod
    def from_metadata(cls, metadata: dict[str, str]) -> Session | None:
        """Read it back; None where it is not one."""
        try:
            return cls(
                recorder=metadata["recorder"],
                name=metadata["name"],
                part=int(metadata["part"]),
                program=metadata["program"],
                host=metadata["host"],
                boot=metadata["boot"],
                offset_ns=_base(metadata).offset_ns,
                vehicle=metadata.get("vehicle", ""),
                config=metadata.get("config", ""),
            )
        except (KeyError, ValueError):
            return None


def _base(metadata: dict[str, str]) -> TimeBase:
    """The clock of a session or a channel.

    Raises:
        KeyError, ValueError: it says none, or one of another age.
    """
    offset = int(metadata["offset_ns"])
    if abs(offset) > LATEST:
        msg = f"a clock of another age: {offset}"
        raise ValueError(msg)
    return TimeBase(metadata["boot"], offset)


def _key(key: str) -> str:
    """A key as it can be on a bus, and in the name of a file.

    Raises:
        ValueError: it cannot.
    """
    if not key.isprintable() or len(key) > LONGEST_KEY:
        msg = f"no key: {key[:LONGEST_KEY]!a}"
        raise ValueError(msg)
    return key


def needs_envelope(entry: Entry) -> bool:
    """Whether an entry carries more than a payload."""
    return bool(entry.issuer or entry.exchange or entry.attachment or entry.source)


@dataclass(frozen=True, slots=True)
class ChannelFacts:
    """Facts common to all entries of one channel.

    Attributes:
        kind: of its entries.
        key: of its entries.
        encoding: of its entries.
        base: of its entries.
        qos: of its entries.
        has_envelope: whether each payload is in a map, beside what else the entry carries.
    """

    kind: EntryKind
    key: str
    encoding: str
    base: TimeBase
    qos: Qos
    has_envelope: bool

    @classmethod
    def of(cls, entry: Entry) -> ChannelFacts:
        """The channel an entry belongs to."""
        return cls(entry.kind, entry.key, entry.encoding, entry.base, entry.qos, needs_envelope(entry))

    @property
    def topic(self) -> str:
        """Name in the file; the bare key belongs to the JSON for viewers."""
        return f"{self.kind}:{self.key}"

    @property
    def schema_name(self) -> str:
        """Name of the payload's schema, for example `mk.Attitude.v1`."""
        return self.encoding.rpartition(";")[2] or "bytes"

    @property
    def message_encoding(self) -> str:
        """What the stored data is, for MCAP."""
        return "msgpack" if self.has_envelope or "msgpack" in self.encoding else "bytes"

    def to_metadata(self) -> dict[str, str]:
        """As metadata of a channel."""
        return {
            "format": FORMAT,
            "kind": self.kind.value,
            "key": self.key,
            "encoding": self.encoding,
            "boot": self.base.boot,
            "offset_ns": str(self.base.offset_ns),
            "congestion": self.qos.congestion.value,
            "priority": str(self.qos.priority),
            "express": "1" if self.qos.express else "0",
            "envelope": "1" if self.has_envelope else "0",
        }

    @classmethod
    def from_metadata(cls, metadata: dict[str, str]) -> ChannelFacts | None:
        """Read it back; None for a channel of another program, or one that only repeats another as JSON."""
        try:
            if metadata["format"] != FORMAT or VIEW in metadata:
                return None
            return cls(
                kind=EntryKind(metadata["kind"]),
                key=_key(metadata["key"]),
                encoding=metadata["encoding"],
                base=_base(metadata),
                qos=Qos(Congestion(metadata["congestion"]), int(metadata["priority"]), metadata["express"] == "1"),
                has_envelope=metadata["envelope"] == "1",
            )
        except (KeyError, ValueError):
            return None

    def pack(self, entry: Entry) -> bytes:
        """What is stored of an entry of this channel."""
        if not self.has_envelope:
            return entry.payload
        envelope: dict[str, Any] = {"payload": entry.payload}
        if entry.issuer:
            envelope["issuer"] = entry.issuer
        if entry.exchange:
            envelope["exchange"] = entry.exchange
        if entry.attachment:
            envelope["attachment"] = entry.attachment
        if entry.source:
            envelope["source"] = entry.source
        packed: bytes = msgpack.packb(envelope)
        return packed

    def unpack(self, data: bytes, sequence: int, log_time: int, publish_time: int) -> Entry:
        """Make the entry again.

        Args:
            data: as stored.
            sequence: of the message.
            log_time: [ns].
            publish_time: [ns].

        Raises:
            ValueError: the data is not what this channel stores, or of another age.
        """
        if not (EARLIEST <= log_time <= LATEST and EARLIEST <= publish_time <= LATEST):
            msg = f"{self.topic}: a time of another age"
            raise ValueError(msg)
        issuer, exchange, attachment, source = "", 0, b"", ""
        if self.has_envelope:
            try:
                envelope = msgpack.unpackb(data)
                data = envelope["payload"]
                issuer = envelope.get("issuer", "")
                exchange = envelope.get("exchange", 0)
                attachment = envelope.get("attachment", b"")
                source = envelope.get("source", "")
            except (TypeError, KeyError, AttributeError, RecursionError, msgpack.exceptions.UnpackException) as error:
                msg = f"{self.topic}: no envelope: {error!r}"
                raise ValueError(msg) from error
            types = (type(data), type(issuer), type(exchange), type(attachment), type(source))
            if types != (bytes, str, int, bytes, str):
                msg = f"{self.topic}: an envelope of other types"
                raise ValueError(msg)
        received, published = (log_time - self.base.offset_ns) / NANOSECONDS, publish_time / NANOSECONDS
        # By position: a recording has a hundred thousand of them.
        head = (self.kind, self.key, data, self.encoding, received, published, self.base, sequence)
        return Entry(*head, issuer, exchange, attachment, self.qos, source)
