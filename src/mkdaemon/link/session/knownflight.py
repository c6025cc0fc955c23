"""What is kept of the boards while they fly, because a FlightCtrl behind a NaviCtrl cannot be asked in flight. Pure.

What is known of the boards dies with a gap in telemetry, with boot text, with a lost FlightCtrl and with the port. In
flight it comes back only where telemetry proves that it is the same aircraft in the same flight: the same NaviCtrl
release, and flying time, used charge and home that go on from where they were. Within one opening of the port that is
enough. After another opening, or in another process, a client must confirm it: see docs/link.md, "A FlightCtrl that
cannot be asked".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final

from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.sighting import FlightState, Sighting, SightingReader
from mkdaemon.protocol.boards import Board
from mkdaemon.protocol.dialect import decide
from mkdaemon.protocol.evidence import Evidence
from mkdaemon.protocol.wire import WireMessage

SHORTEST_BOOT: Final = 4.0
"""A FlightCtrl that was lost for less has not booted [s]; it takes 4.7 s. Source: docs/firmware-notes."""
FRESH: Final = 3.0
"""An offer holds for so long after telemetry last proved it [s]."""


@dataclass(frozen=True, slots=True)
class FlightMemory:
    """A pair of boards in flight.

    Attributes:
        evidence: what the boards showed of themselves.
        layout: layout of external control that was in use.
        sighting: the latest look at the flight.
    """

    evidence: Evidence
    layout: str
    sighting: Sighting

    @property
    def firmware(self) -> str:
        """The release of the FlightCtrl."""
        return str(self.evidence.releases[Board.FC])


class Change(Enum):
    """What a look at the flight changes."""

    NOTHING = auto()
    FLIGHTCTRL_LOST = auto()
    """The NaviCtrl has stopped hearing its FlightCtrl, which may boot."""
    SAME_FLIGHT = auto()
    """What was known before is true again."""


class KnownFlight:
    """Follows the flight under way.

    Attributes:
        memory: what to know again; None on the ground.
    """

    def __init__(self, peers: Peers) -> None:
        self._peers = peers
        self._reader = SightingReader()
        self._is_unbroken = False
        self._proven_at: float | None = None
        self._lost_since: float | None = None
        self.memory: FlightMemory | None = None

    def recall(self, memory: FlightMemory) -> None:
        """Take what an earlier process knew; telemetry must prove it, and a client confirm it."""
        if self.memory is None:
            self.memory, self._is_unbroken = memory, False

    def port_opened(self) -> None:
        """Whatever is at the other end now must be confirmed."""
        self._reader = SightingReader()
        self._is_unbroken = False
        self._proven_at = self._lost_since = None

    def board_boots(self) -> None:
        """The flight is over, or will never be known again."""
        self.memory = self._proven_at = None

    def machine_slept(self, seconds: float) -> None:
        """The flight went on for so long unseen [s]: a client must confirm it."""
        self._is_unbroken = False
        if self.memory is not None:
            seen = self.memory.sighting
            self.memory = replace(self.memory, sighting=replace(seen, at=seen.at - seconds))

    def offer(self, now: float) -> FlightMemory | None:
        """What a client may confirm now; None for nothing."""
        is_proven = self._proven_at is not None and now - self._proven_at <= FRESH
        return self.memory if is_proven and self._peers.dialect.extern_control is None else None

    def telemetry_received(self, message: WireMessage, now: float) -> Change:
        """Take a look at the flight; returns what that changes."""
        look = self._reader.read(message, now)
        if look is None:
            return Change.NOTHING
        if look.state is FlightState.FC_LOST:
            is_first, self._lost_since = self._lost_since is None, self._lost_since or now
            self._proven_at = None
            return Change.FLIGHTCTRL_LOST if is_first else Change.NOTHING
        if self._lost_since is not None:
            self._is_unbroken = self._is_unbroken and now - self._lost_since < SHORTEST_BOOT
            self._lost_since = None
        return self._compare(look)

    def _compare(self, look: Sighting) -> Change:
        """Keep what is known, or find out whether this is the flight that was known."""
        dialect = self._peers.dialect
        if dialect.extern_control_layout is not None:
            is_kept = look.state is FlightState.FLYING and dialect.via_navictrl
            evidence, layout = self._peers.evidence, dialect.extern_control_layout
            self.memory = FlightMemory(evidence, layout, look) if is_kept else None
            self._is_unbroken = is_kept
            self._proven_at = None
            return Change.NOTHING
        memory = self.memory
        if memory is None or Board.NC not in self._peers.evidence.releases:
            return Change.NOTHING
        if not memory.sighting.continues_as(look) or not self._fits(memory):
            self.memory = self._proven_at = None
            return Change.NOTHING
        self.memory, self._proven_at = replace(memory, sighting=look), look.at
        return Change.SAME_FLIGHT if self._is_unbroken else Change.NOTHING

    def _fits(self, memory: FlightMemory) -> bool:
        """Whether the boards of today, with what was known, speak as they did then."""
        dialect = decide(self._peers.evidence.with_flightctrl_of(memory.evidence))
        is_same = self._peers.evidence.releases[Board.NC] == memory.evidence.releases[Board.NC]
        return is_same and dialect.extern_control_layout == memory.layout
