"""What the daemon was told from beside the bus and the line, and when it woke: a replay needs it, nobody watches it.

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

    CONTROL_WOKE = "control_woke"
    """The flight core decided, by this time; nothing else is said."""
    LINE_WOKE = "line_woke"
    """The line was looked at: what came, what may be written, what is overdue; nothing else is said."""
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
