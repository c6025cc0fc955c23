"""Whether the aircraft at a port that was lost and came back is the one from before. Pure; driven with `now`.

`/dev/ttyUSB0`, `/dev/pts/3` and `tcp:host:port` name a place, not a device. Until the board there has answered as the
one before did, only questions without side effects are written to it: the version, then the position (NaviCtrl) or
the active parameter set (FlightCtrl, motors known off; 255 is the only index that changes nothing).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from mkdaemon.frames import enu_from_geodetic
from mkdaemon.link.session.line import RESYNC
from mkdaemon.link.session.release import QUIET_TIME
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.flags import PositionStatus
from mkdaemon.protocol.generations import DeadMan
from mkdaemon.protocol.messages import OsdData4, OsdData5, OsdSet, Settings, VersionReply, VersionRequest
from mkdaemon.protocol.messages.navictrl import ESCAPE
from mkdaemon.protocol.messages.osd import OsdRequestV1
from mkdaemon.protocol.messages.parameters import ACTIVE_SET, SettingsRequest, SettingsWritten
from mkdaemon.protocol.wire import Board, WireMessage

ASK_AGAIN: Final = 0.15
"""An unanswered question is repeated after this [s]; a radio's longest round trip is 0.13 s."""
ASK_TIME: Final = 1.0
"""Questions that keep an old stick command alive stop after this, and resume after `QUIET_TIME` [s]."""
ASK_SELDOM: Final = 0.5
"""After `ASK_TIME` a question is repeated this often [s]."""
SET_QUESTIONS: Final = 4
"""A FlightCtrl 2.00a whose motors run never sends its set: after this number of questions the version must do."""
SLACK_M: Final = 1000.0
"""Two positions of one aircraft may differ by this much more than `TOP_SPEED` explains: a first fix can be poor [m]."""
TOP_SPEED: Final = 60.0
"""Faster than a MikroKopter, and than a car that carries one [m/s]."""
_FACTS: Final = ("release", "protocol_major", "hardware", "label_checksum")
"""What a version reply says that is constant for one board."""


@dataclass(frozen=True, slots=True)
class Fix:
    """A position.

    Attributes:
        at: when it arrived [s; monotonic].
        latitude: [rad].
        longitude: [rad].
    """

    at: float
    latitude: float
    longitude: float

    def distance(self, other: Fix) -> float:
        """Distance between two positions [m]; exact only if small."""
        east, north, _ = enu_from_geodetic(other.latitude, other.longitude, 0.0, (self.latitude, self.longitude, 0.0))
        return math.hypot(east, north)


def read_fix(message: WireMessage, now: float) -> Fix | None:
    """Return the position that telemetry tells; None where it tells none."""
    match message:
        case OsdData4() | OsdData5() if message.position_status != PositionStatus.INVALID:
            return Fix(
                now, math.radians(message.si("position_latitude")), math.radians(message.si("position_longitude"))
            )
        case OsdSet() if message.latitude or message.longitude:
            names = ("latitude", "longitude")
        case _:
            return None
    latitude, longitude = (math.radians(message.si(name)) for name in names)
    return Fix(now, latitude, longitude)


@dataclass(slots=True)
class KnownAircraft:
    """Identity of the aircraft on the line, kept over every opening of the port.

    Attributes:
        versions: what each board said of its firmware.
        sets: parameter sets that were read, by number.
        fix: the latest position; None while unknown.
        was_redirected: the NaviCtrl passed the line through when the port was lost.
    """

    versions: dict[Board, dict[str, object]] = field(default_factory=dict)
    sets: dict[int, bytes] = field(default_factory=dict)
    fix: Fix | None = None
    was_redirected: bool = False

    def forget(self) -> None:
        """Another aircraft may be there, and that is as it should be."""
        self.versions.clear()
        self.sets.clear()
        self.fix = None

    def note(self, board: Board, message: WireMessage, now: float) -> None:
        """Take what a message tells; never the answer to a `VersionRequestWhich`, which is about another board."""
        match message:
            case VersionReply():
                facts = _facts(message)
                if self.versions.setdefault(board, facts) != facts:
                    self.forget()
                    self.versions[board] = facts
            case Settings():
                self.sets[message.index] = message.parameters
            case SettingsWritten():
                self.sets.clear()
            case _:
                self.fix = read_fix(message, now) or self.fix

    def find_difference(self, board: Board, message: WireMessage | Unknown, now: float) -> str | None:
        """Return in what way a message cannot come from this aircraft; None where it can."""
        match message:
            case Unknown():
                return f"{board.word} is not MikroKopter firmware" if message.id == VersionRequest.spec.reply else None
            case VersionReply():
                return self._compare_version(board, _facts(message))
            case Settings():
                before = self.sets.get(message.index, message.parameters)
                return None if before == message.parameters else f"parameter set {message.index} has other values"
        fix = read_fix(message, now)
        if fix is None or self.fix is None:
            return None
        distance = self.fix.distance(fix)
        if distance <= SLACK_M + TOP_SPEED * (now - self.fix.at):
            return None
        return f"it is {distance / 1000:,.0f} km from the last position"

    def find_misplaced(self, board: Board) -> str | None:
        """Return in what way another board than before is at the end of the wire; None where it is the same.

        A NaviCtrl may still pass the line through, to a FlightCtrl that is perhaps not known yet.
        """
        direct = Board.NC if Board.NC in self.versions else Board.FC
        return None if board is direct or self.was_redirected else f"{board.word} answers where {direct.word} did"

    def _compare_version(self, board: Board, facts: dict[str, object]) -> str | None:
        known = self.versions.get(board, facts)
        changed = next((name for name in _FACTS if facts.get(name) != known.get(name)), None)
        if changed is None:
            return None
        return f"{board.word} has {changed.replace('_', ' ')} {facts.get(changed)}, before {known.get(changed)}"


def _facts(reply: VersionReply) -> dict[str, object]:
    return {name: getattr(reply, name) for name in _FACTS if hasattr(reply, name)}


class IdentityCheck:
    """After a port came back, asks for the aircraft's identity until it is known whether it is the same one.

    Attributes:
        is_same: everything that could be asked was answered as before.
        difference: why it is another aircraft; empty while nothing says so.
        is_answered: a right frame arrived.
    """

    def __init__(self, known: KnownAircraft, dead_man: DeadMan, now: float, *, may_read_set: bool) -> None:
        """Begin.

        Args:
            known: the aircraft from before.
            dead_man: of its FlightCtrl, so that questions do not keep an old stick command alive.
            now: [s; monotonic].
            may_read_set: the motors stood still when the port was lost.
        """
        self._known = known
        self._keeps_alive = dead_man.refreshed_by(VersionRequest.spec.id)
        self._may_read_set = may_read_set
        self._board: Board | None = None
        self._has_fix = self._has_set = False
        self._set_questions = 0
        self._escapes_next = self._has_placed = False
        self._round_began = self._next = now
        self.is_same = self.is_answered = False
        self.difference = ""

    def due(self, now: float) -> tuple[bytes, WireMessage | None] | None:
        """Return the question to write now, and the message that it is; None for none."""
        if now < self._next or self.is_same or self.difference:
            return None
        if self._keeps_alive and now - self._round_began > ASK_TIME:
            self._round_began = self._next = now + QUIET_TIME
            return None
        is_late = now - self._round_began > ASK_TIME
        self._next = now + (ASK_SELDOM if is_late else ASK_AGAIN)
        if self._escapes_next:
            self._escapes_next = False
            return ESCAPE, None
        self._escapes_next = is_late and self._known.was_redirected and self._board is None
        board, message = self._question()
        return RESYNC + message.to_frame(board), message

    def accept(self) -> None:
        """A client says that whatever is there may be spoken to."""
        self.is_same = True

    def next_time(self) -> float:
        """When `due` has something next [s]; infinite when it is decided."""
        return math.inf if self.is_same or self.difference else self._next

    def received(self, board: Board, message: WireMessage | Unknown, now: float) -> None:
        """A right frame arrived."""
        self.is_answered = True
        self.difference = self.difference or self._known.find_difference(board, message, now) or ""
        match message:
            case VersionReply():
                self._board = board
                self._place(board)
            case Settings():
                self._has_set = True
            case OsdData4() | OsdData5() | OsdSet():
                self._has_fix = True
            case _:
                return
        self.is_same = not self.difference and self._has_answered
        self._next = now

    def _place(self, board: Board) -> None:
        """Judge which board answers; the known FlightCtrl in place of its NaviCtrl gets the end of a passage first."""
        misplaced = self._known.find_misplaced(board)
        if misplaced and not self.difference and board in self._known.versions and not self._has_placed:
            self._escapes_next, self._board = True, None
        else:
            self.difference = self.difference or misplaced or ""
        self._has_placed = True

    @property
    def _has_answered(self) -> bool:
        if self._board is Board.NC and self._known.fix is not None:
            return self._has_fix
        if self._board is Board.FC and self._known.sets and self._may_read_set:
            return self._has_set or self._set_questions > SET_QUESTIONS
        return self._board is not None

    def _question(self) -> tuple[Board, WireMessage]:
        if self._board is None:
            return Board.ANY, VersionRequest()
        if self._board is Board.NC:
            return Board.NC, OsdRequestV1(interval=255)
        self._set_questions += 1
        self.is_same = self._has_answered
        return Board.FC, SettingsRequest(index=ACTIVE_SET)
