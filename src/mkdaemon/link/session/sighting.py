"""What a NaviCtrl's telemetry tells of the flight under way: enough to know the same flight again later. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from mkdaemon.protocol.errorcodes import is_fc_lost
from mkdaemon.protocol.flags import FlightStatus, OsdStatus2, PositionStatus
from mkdaemon.protocol.messages import OsdData4, OsdData5
from mkdaemon.protocol.messages.osdsets import OsdDeviation, OsdFlags, OsdVolatile
from mkdaemon.protocol.wire import WireMessage

TIME_SLACK: Final = 3.0
"""Flying time counts whole seconds, and telemetry is up to 2.55 s apart [s]."""
CLOCK_DRIFT: Final = 0.01
"""A board's second may be this much longer or shorter; the NaviCtrl counts flying time. Source: docs/firmware-notes."""
CHARGE_SLACK: Final = 5
"""Used charge may be so much less or more than the current explains [mAh]."""
MOST_CHARGE: Final = 40.0
"""No MikroKopter draws more [mAh/s]; 144 A."""


class FlightState(Enum):
    """What one look shows."""

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
