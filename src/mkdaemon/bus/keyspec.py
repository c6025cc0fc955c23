"""A row of the table of keys."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from pydantic import BaseModel

REQUEST_BYTES: Final = 4096
"""Longest request [bytes]; five parameter sets are 1,100."""
_SETPOINT_BYTES: Final = 512
"""Longest setpoint [bytes]; the longest honest one is below 200."""
_MISSION_BYTES: Final = 1 << 17
"""Longest request with a mission [bytes]; 254 points are up to 80,000."""
_CARRY_MISSION: Final = frozenset({"do/waypoints_upload", "do/waypoints_verify"})
_PATH_BYTES: Final = 1 << 18
"""Longest path [bytes]; 500 polynomials are up to 165,000."""
_CARRY_PATH: Final = "do/path_upload"


class Use(StrEnum):
    """Use of a key."""

    PUBLISHED = "published"
    """The daemon puts it; a query answers with the last value and its `age`."""
    CLIENT = "client"
    """Another program than the daemon puts it."""
    QUERY = "query"
    """A client asks; the answer is a `CommandResult` or a schema."""
    SETPOINT = "setpoint"
    """A client streams it; the newest wins."""
    TOKEN = "token"
    """A liveliness token."""


@dataclass(frozen=True, slots=True)
class KeySpec:
    """One family of keys.

    Attributes:
        suffix: what follows `mk/<vehicle>/`; `<word>` stands for any one chunk.
        use: how it is used.
        carries: model of the payload; None for a payload described by `about`.
        when: how often, or on what.
        about: what it says.
        reply: model of the answer to a query, inside its `CommandResult`; None if there is no separate one.
        fresh: how old the last value may be and still be the present one [s]: three periods, with the patience that a
            busy machine needs. Infinity: until the next one, while anything of the daemon is fresh. None: it
            is an event.
    """

    suffix: str
    use: Use
    carries: type[BaseModel] | None
    when: str
    about: str
    reply: type[BaseModel] | None = None
    fresh: float | None = None

    @property
    def pattern(self) -> str:
        """The suffix as a Zenoh key expression."""
        return re.sub(r"<[^>]+>", "*", self.suffix)

    @property
    def max_bytes(self) -> int:
        """Longest payload that is read from a client [bytes]."""
        if self.use is Use.SETPOINT:
            return _SETPOINT_BYTES
        if self.suffix == _CARRY_PATH:
            return _PATH_BYTES
        return _MISSION_BYTES if self.suffix in _CARRY_MISSION else REQUEST_BYTES
