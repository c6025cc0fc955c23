"""Memory of the boards in flight, because a FlightCtrl behind a NaviCtrl cannot be identified in flight. Pure.

What is known of the boards dies with a gap in telemetry, with boot text, with a lost FlightCtrl and with the port. In
flight it comes back only where telemetry proves that it is the same aircraft in the same flight: the same NaviCtrl
release, and flying time, used charge and home that go on from where they were. Within one opening of the port that is
enough. After another opening, or in another process, a client must confirm it: see docs/link.md,
"A FlightCtrl that cannot be identified".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final

from mkdaemon.link.session.peers import Peers
from mkdaemon.protocol.boards import Board
from mkdaemon.protocol.dialect import decide
from mkdaemon.protocol.errorcodes import is_fc_lost
from mkdaemon.protocol.evidence import Evidence
from mkdaemon.protocol.flags import FlightStatus, OsdStatus2, PositionStatus
from mkdaemon.protocol.messages import OsdData4, OsdData5
from mkdaemon.protocol.messages.osdsets import OsdDeviation, OsdFlags, OsdVolatile
from mkdaemon.protocol.wire import WireMessage

TIME_SLACK: Final = 3.0
"""Flying time counts whole seconds, and telemetry is up to 2.55 s apart [s]."""
CLOCK_DRIFT: Final = 0.01
"""A board's second may be this much longer or shorter; the NaviCtrl counts flying time. Source: docs/firmware-notes."""
CHARGE_SLACK: Final = 5
"""Allowed difference between used charge and the integral of the current [mAh]."""
MOST_CHARGE: Final = 40.0
"""No MikroKopter draws more [mAh/s]; 144 A."""


class FlightState(Enum):
    """One observation of the flight."""

    FC_LOST = auto()
    """The NaviCtrl does not hear its FlightCtrl."""
    ON_GROUND = auto()
    """The motors stand still, or the aircraft has not taken off."""
    FLYING = auto()
    """Motors run, and it has taken off since they were started."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """One look at the flight.

    Attributes:
        at: when [s; monotonic].
        state: what it does.
        flying_time: time in the air, as the NaviCtrl counts it [s].
        used_mah: charge used, as the FlightCtrl counts it [mAh].
        home: longitude and latitude where the motors were started [1e-7 deg]; None while unknown.
    """

    at: float
    state: FlightState
    flying_time: float = 0.0
    used_mah: int = 0
    home: tuple[int, int] | None = None

    def continues_as(self, later: Sighting) -> bool:
        """Whether a later look shows the same flight: it went on all the time, by every count there is."""
        elapsed = later.at - self.at
        if elapsed < 0 or not self.state is later.state is FlightState.FLYING:
            return False
        flown, drawn = later.flying_time - self.flying_time, later.used_mah - self.used_mah
        has_time = abs(flown - elapsed) <= TIME_SLACK + CLOCK_DRIFT * elapsed
        has_charge = -CHARGE_SLACK <= drawn <= CHARGE_SLACK + MOST_CHARGE * elapsed
        has_home = self.home is None or later.home is None or self.home == later.home
        return has_time and has_charge and has_home


class SightingReader:
    """Makes sightings of NaviData, also of the sets that tell one thing each."""

    def __init__(self) -> None:
        self._is_flying = False
        self._power: OsdVolatile | None = None

    def read(self, message: WireMessage, now: float) -> Sighting | None:
        """Return what a message shows; None where it shows nothing of the flight."""
        match message:
            case OsdData4() | OsdData5():
                return _from_osd(message, now)
            case OsdFlags():
                return self._from_flags(message, now)
            case OsdVolatile():
                self._power = message
            case OsdDeviation() if self._is_flying and self._power is not None:
                return Sighting(now, FlightState.FLYING, message.si("flying_time"), self._power.used_capacity)
        return None

    def _from_flags(self, flags: OsdFlags, now: float) -> Sighting | None:
        """Return what the flags show; a flight is shown by the set that counts its time."""
        wanted = OsdStatus2.MOTORS_RUNNING | OsdStatus2.FLYING
        self._is_flying = flags.status_2 & wanted == wanted and not is_fc_lost(flags.error_code)
        if is_fc_lost(flags.error_code):
            return Sighting(now, FlightState.FC_LOST)
        return None if self._is_flying else Sighting(now, FlightState.ON_GROUND)


def _from_osd(osd: OsdData4 | OsdData5, now: float) -> Sighting:
    if is_fc_lost(osd.error_code):
        return Sighting(now, FlightState.FC_LOST)
    # Motors and flying are the same bits in both generations of the flags.
    wanted = FlightStatus.MOTORS_RUNNING | FlightStatus.FLYING
    if osd.fc_flags & wanted != wanted:
        return Sighting(now, FlightState.ON_GROUND)
    has_home = osd.home_status != PositionStatus.INVALID
    home = (osd.home_longitude, osd.home_latitude) if has_home else None
    return Sighting(now, FlightState.FLYING, osd.si("flying_time"), osd.used_capacity, home)


SHORTEST_BOOT: Final = 4.0
"""A FlightCtrl that was lost for less has not booted [s]; it takes 4.7 s. Source: docs/firmware-notes."""
FRESH: Final = 3.0
"""An offer is valid for this time after telemetry last proved it [s]."""


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


class FlightChange(Enum):
    """Change by an observation of the flight."""

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
        """The flight continued unseen for longer than this [s]: a client must confirm it."""
        self._is_unbroken = False
        if self.memory is not None:
            seen = self.memory.sighting
            self.memory = replace(self.memory, sighting=replace(seen, at=seen.at - seconds))

    def offer(self, now: float) -> FlightMemory | None:
        """What a client may confirm now; None without an offer."""
        is_proven = self._proven_at is not None and now - self._proven_at <= FRESH
        return self.memory if is_proven and self._peers.dialect.extern_control is None else None

    def telemetry_received(self, message: WireMessage, now: float) -> FlightChange:
        """Take a look at the flight; returns what that changes."""
        look = self._reader.read(message, now)
        if look is None:
            return FlightChange.NOTHING
        if look.state is FlightState.FC_LOST:
            is_first, self._lost_since = self._lost_since is None, self._lost_since or now
            self._proven_at = None
            return FlightChange.FLIGHTCTRL_LOST if is_first else FlightChange.NOTHING
        if self._lost_since is not None:
            self._is_unbroken = self._is_unbroken and now - self._lost_since < SHORTEST_BOOT
            self._lost_since = None
        return self._compare(look)

    def _compare(self, look: Sighting) -> FlightChange:
        """Keep what is known, or find out whether this is the flight that was known."""
        dialect = self._peers.dialect
        if dialect.extern_control_layout is not None:
            is_kept = look.state is FlightState.FLYING and dialect.via_navictrl
            evidence, layout = self._peers.evidence, dialect.extern_control_layout
            self.memory = FlightMemory(evidence, layout, look) if is_kept else None
            self._is_unbroken = is_kept
            self._proven_at = None
            return FlightChange.NOTHING
        memory = self.memory
        if memory is None or Board.NC not in self._peers.evidence.releases:
            return FlightChange.NOTHING
        if not memory.sighting.continues_as(look) or not self._fits(memory):
            self.memory = self._proven_at = None
            return FlightChange.NOTHING
        self.memory, self._proven_at = replace(memory, sighting=look), look.at
        return FlightChange.SAME_FLIGHT if self._is_unbroken else FlightChange.NOTHING

    def _fits(self, memory: FlightMemory) -> bool:
        """Whether the boards of today, with what was known, speak as they did then."""
        dialect = decide(self._peers.evidence.with_flightctrl_of(memory.evidence))
        is_same = self._peers.evidence.releases[Board.NC] == memory.evidence.releases[Board.NC]
        return is_same and dialect.extern_control_layout == memory.layout
