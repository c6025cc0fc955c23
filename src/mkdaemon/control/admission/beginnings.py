"""What admission decides about: the lease, each kind of manoeuvre, board requests, procedures, the NaviCtrl's flights.

A beginning carries what is asked for, as plain facts. What else counts stands in `Situation`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Final

from mkdaemon.telemetry.danger import Confirm, Danger, Switch
from mkdaemon.telemetry.mission import MissionPoint
from mkdaemon.telemetry.setpoint import Setpoint, SetpointFrame


class Concern(StrEnum):
    """Kinds of beginnings; a row of the table names those that it concerns."""

    LEASE = "lease"
    STICK = "stick"
    ATTITUDE = "attitude"
    VELOCITY = "velocity"
    POSITION = "position"
    HOLD = "hold"
    PATH = "path"
    TAKE_OFF = "takeoff"
    LAND = "land"
    REQUEST = "request to a board"
    PROCEDURE = "procedure"
    UPLOAD = "upload of points"
    ROUTE = "start of a route"
    NAVI_GOTO = "target for the NaviCtrl"

    @property
    def is_by_target(self) -> bool:
        """Whether it is a manoeuvre that is flown by the estimate against the target."""
        return self in BY_TARGET


BY_HAND: Final = (Concern.STICK, Concern.ATTITUDE)
"""Manoeuvres whose sticks a client makes itself."""
BY_TARGET: Final = (Concern.VELOCITY, Concern.POSITION, Concern.HOLD, Concern.PATH, Concern.TAKE_OFF, Concern.LAND)
"""Manoeuvres that are flown by the estimate against the target."""
MANOEUVRES: Final = (*BY_HAND, *BY_TARGET)
"""Every kind of manoeuvre; the value is the last word of the key of its setpoint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeLease:
    """A client takes the lease.

    Attributes:
        holder: its name.
        force: take the lease from its present holder.
        path_delay: the way to the client and back [s]; infinite where its echo is not known, None where it has not been
            measured.
        is_early: asked before the FlightCtrl is known and its active set is read.
    """

    holder: str = ""
    force: bool = False
    path_delay: float | None = None
    is_early: bool = False

    concern: ClassVar = Concern.LEASE


@dataclass(frozen=True, slots=True)
class NewManoeuvre:
    """A manoeuvre begins, or takes the place of the one that is flown.

    Attributes:
        concern: what begins; one of `MANOEUVRES`.
        frame: in which it is given; None for a kind that has none.
        target: name of the target it is flown by; empty for the one in sight.
        path: id of the path that it flies along; empty for none.
        is_resumed: a flight by the target goes on with it, in the air, when the aircraft answers its sticks again.
    """

    concern: Concern
    frame: SetpointFrame | None = None
    target: str = ""
    path: str = ""
    is_resumed: bool = False

    is_early: ClassVar = False

    @classmethod
    def by(cls, setpoint: Setpoint) -> NewManoeuvre:
        """The manoeuvre that a setpoint asks for."""
        return cls(
            Concern(setpoint.kind),
            frame=getattr(setpoint, "frame", None),
            target=getattr(setpoint, "target", ""),
            path=getattr(setpoint, "path", ""),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardRequest:
    """A client sends a request to a board.

    Attributes:
        board: word of the board.
        name: of the request.
        danger: what makes it dangerous; None where it is harmless as it stands.
        is_confirmed: it carries `confirm = true`.
        switches: what the configuration turns on.
        is_slow: stick frames do not reach the aircraft meanwhile, and the last tilt would come back afterwards.
        is_to_flightctrl: the FlightCtrl is asked.
        unsupported: why this firmware does not know it; empty where it does.
        read_only: why this aircraft must not be written to; empty where it may be.
        deaf_time: for this time the board's buzzer makes it deaf [s].
        unproven: the last version reply if it does not prove the board; empty if it does, or before the first
            request.
        is_step: it is a step of the running procedure, which was admitted as a whole.
        is_early: asked before the aircraft is known and telemetry about the motors is fresh.
    """

    board: str
    name: str
    danger: Danger | None = None
    is_confirmed: bool = False
    switches: frozenset[Switch] = frozenset()
    is_slow: bool = False
    is_to_flightctrl: bool = False
    unsupported: str = ""
    read_only: str = ""
    deaf_time: float = 0.0
    unproven: str = ""
    is_step: bool = False
    is_early: bool = False

    concern: ClassVar = Concern.REQUEST

    @property
    def title(self) -> str:
        """Board and request, for a refusal."""
        return f"{self.board}/{self.name}"

    @property
    def is_disturbing(self) -> bool:
        """Whether it would disturb a procedure or a flight."""
        is_dangerous = self.danger is not None and self.danger.confirm is Confirm.IN_FLIGHT
        return not self.is_step and (self.is_slow or is_dangerous)


@dataclass(frozen=True, slots=True, kw_only=True)
class Procedure:
    """A client begins a procedure.

    Attributes:
        verb: its name.
        is_alone: it excludes flying, and needs motors that stand still.
        needs_live_set: it must not begin before the live set is proven.
        can_fly: it may be done in flight, if the request says so.
        unconfirmed: what it writes, where the request does not carry `confirm = true`; empty where it does.
        is_early: asked before telemetry about the motors is fresh.
    """

    verb: str
    is_alone: bool = False
    needs_live_set: bool = False
    can_fly: bool = False
    unconfirmed: str = ""
    is_early: bool = False

    concern: ClassVar = Concern.PROCEDURE


@dataclass(frozen=True, slots=True)
class ListUpload:
    """A client replaces the NaviCtrl's points.

    Attributes:
        points: the new ones.
        allow_unusual: they are meant, however strange they look.
    """

    points: tuple[MissionPoint, ...]
    allow_unusual: bool = False
    is_early: bool = False

    concern: ClassVar = Concern.UPLOAD


@dataclass(frozen=True, slots=True)
class StartRoute:
    """A client makes the list ready to be flown by the pilot's switch."""

    is_early: bool = False

    concern: ClassVar = Concern.ROUTE


@dataclass(frozen=True, slots=True)
class NaviGoto:
    """A client gives the NaviCtrl a place to fly to.

    Attributes:
        up: height of the place above the start [m].
    """

    up: float
    is_early: bool = False

    concern: ClassVar = Concern.NAVI_GOTO


Beginning = TakeLease | NewManoeuvre | BoardRequest | Procedure | ListUpload | StartRoute | NaviGoto
"""Everything that may begin."""
