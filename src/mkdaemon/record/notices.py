"""What the daemon was told from beside the bus and the line, and what it saw on its clock: a replay needs it.

A notice is an entry of kind `notice` with the key `mk/<vehicle>/notice/<what>`; its payload is a msgpack map, or
nothing.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final

from mkdaemon.record.entry import Entry, Kind

ROOT: Final = "notice/"


class Notice(StrEnum):
    """What it is about."""

    LOOKS = "looks"
    """What the replayed part of the daemon saw on its clock since the notice before; see `looks`."""
    IMAGE_SEEN = "image_seen"
    """An image was looked at: `camera`, `sequence`, `attitude`, the time of the newest attitude known by then [s]."""
    CLIENT = "client"
    """A client showed or withdrew its liveliness token: `name`, `is_here`."""
    GUARD_ALIVE = "guard_alive"
    """The guard is there or gone: `is_alive`."""
    GUARD_ACTED = "guard_acted"
    """The guard sent something: `released`."""
    SETPOINT_REFUSED = "setpoint_refused"
    """The setpoint before it was refused: `key` without `mk/<vehicle>/`, `sequence` of its entry, `token`, `reason`."""
    STOP = "stop"
    """The daemon was told to end in order; nothing else is said."""

    @property
    def suffix(self) -> str:
        """The key without `mk/<vehicle>/`."""
        return ROOT + self.value

    @classmethod
    def of(cls, entry: Entry) -> Notice | None:
        """What an entry is about; None where it is no notice of these."""
        word = entry.suffix.removeprefix(ROOT)
        return cls(word) if entry.kind is Kind.NOTICE and word in set(cls) else None
