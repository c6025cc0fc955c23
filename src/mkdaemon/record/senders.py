"""Who sent setpoints and requests, by the sessions they say they come from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import msgpack

from mkdaemon.record.entry import HOLDER, Entry, Kind
from mkdaemon.record.notices import Notice

LEASE: Final = "do/lease"
_ACCEPTED: Final = "accepted"


@dataclass
class Sender:
    """One session.

    Attributes:
        source: its Zenoh id, as it says itself; `local` for the Unix socket; empty for those that say none.
        names: under which it asked for the lease.
        setpoints: that arrived.
        signed: of these, signed with the secret of the lease.
        setpoints_refused: of these, by token.
        requests: that arrived.
        requests_refused: of these, not accepted.
    """

    source: str
    names: set[str] = field(default_factory=set)
    setpoints: int = 0
    signed: int = 0
    setpoints_refused: dict[str, int] = field(default_factory=dict)
    requests: int = 0
    requests_refused: int = 0


class Senders:
    """Counts them.

    Attributes:
        found: by source.
    """

    def __init__(self) -> None:
        self.found: dict[str, Sender] = {}
        self._setpoints: dict[str, tuple[int, Sender]] = {}
        self._asking: dict[int, Sender] = {}

    def take(self, entry: Entry) -> None:
        """Count an entry."""
        if entry.kind is Kind.SETPOINT:
            sender = self._sender(entry)
            sender.setpoints += 1
            sender.signed += entry.issuer == HOLDER
            self._setpoints[entry.suffix] = (entry.sequence, sender)
        elif entry.kind is Kind.QUERY:
            sender = self._asking[entry.exchange] = self._sender(entry)
            sender.requests += 1
            if entry.suffix == LEASE and (holder := _fields(entry).get("holder")):
                sender.names.add(str(holder))
        elif entry.kind is Kind.REPLY:
            asked = self._asking.pop(entry.exchange, None)
            if asked is not None:
                asked.requests_refused += _fields(entry).get("status") != _ACCEPTED
        elif Notice.of(entry) is Notice.SETPOINT_REFUSED:
            self._count_refused(_fields(entry))

    def _sender(self, entry: Entry) -> Sender:
        return self.found.setdefault(entry.source, Sender(entry.source))

    def _count_refused(self, fields: dict[str, Any]) -> None:
        sequence, sender = self._setpoints.get(str(fields.get("key")), (0, None))
        if sender is not None and sequence == fields.get("sequence"):
            token = str(fields.get("token"))
            sender.setpoints_refused[token] = sender.setpoints_refused.get(token, 0) + 1


def _fields(entry: Entry) -> dict[str, Any]:
    try:
        found = msgpack.unpackb(entry.payload)
    except (ValueError, msgpack.exceptions.UnpackException):
        return {}
    return found if isinstance(found, dict) else {}
