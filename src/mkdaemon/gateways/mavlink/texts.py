"""STATUSTEXT: events of the daemon, to every station; the words of a refusal, to the station that asked.

Source: https://mavlink.io/en/messages/common.html#STATUSTEXT (pieces of 50 bytes).
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final, Protocol

from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.gateways.mavlink.dialect import Message, mavlink
from mkdaemon.gateways.mavlink.stations import Station
from mkdaemon.reading import Sort, line_of
from mkdaemon.telemetry.refusals import Token
from mkdaemon.telemetry.tone import Tone

PIECE: Final = 50
_LONGEST: Final = 400
"""Bytes of a text; what is longer ends in dots."""
AGAIN: Final = 3.0
"""Time in which the same text is not repeated [s]."""
_REMEMBERED: Final = 64
READ: Final = ("event/failsafe", "event/mode", "event/log", "event/mission")
"""Keys of the events that are sent."""
CRITICAL: Final = int(mavlink.MAV_SEVERITY_CRITICAL)
ERROR: Final = int(mavlink.MAV_SEVERITY_ERROR)
WARNING: Final = int(mavlink.MAV_SEVERITY_WARNING)
NOTICE: Final = int(mavlink.MAV_SEVERITY_NOTICE)
INFO: Final = int(mavlink.MAV_SEVERITY_INFO)
REMEDIES: Final[dict[str, str]] = {
    Token.MALFORMED: "This is a defect of the gateway.",
    Token.BAD_FIELD: "Correct it in the ground station.",
    Token.REMEMBERED_ONLY: "Land and stop the motors, then try again.",
    Token.NOTHING_REMEMBERED: "Land and stop the motors, then try again.",
    Token.OTHER_AIRCRAFT: "Connect the aircraft from before, or restart the daemon.",
    Token.AIRCRAFT_UNPROVEN: "Check power and wiring, or restart the daemon.",
    Token.BOARD_UNPROVEN: "Behind a NaviCtrl the line goes to another board: switch it back.",
    Token.NOT_CONFIRMED: "This is a defect of the gateway.",
    Token.FLYING_STOP: "Land first; a disarm that is forced stops the motors in the air.",
    Token.LEASE_HELD: "Ask the holder to give it back.",
    Token.NO_FRAME: "Give it in LOCAL_NED or BODY_FRD.",
    Token.GATE_CONSTANT: "Set EXTERNAL_CONTROL to a switch of the transmitter.",
    Token.IN_FLIGHT_NEEDED: "Land and stop the motors, then try again.",
    Token.POINT_UNUSUAL: "Correct the point.",
    Token.NO_PATH: "Upload the mission again.",
    Token.TARGET_UNCLEAR: "Start the gateway with the name of the target (docs/mavlink.md).",
    Token.POSITION_POOR: "Start the motors under open sky with a fix, for that sets home.",
    Token.RECORDING: "Connect an aircraft.",
    Token.NOT_SIMULATED: "Start a simulator.",
}
"""What a user of a ground station can do, where the refusal's own fix names an option of another program."""
_SEVERITIES: Final = {Tone.BAD: ERROR, Tone.WARN: WARNING}


class Notify(Protocol):
    """Tells one ground station."""

    def __call__(self, station: Station, text: str, severity: int = WARNING) -> None:
        """Send it a text."""


class Texts:
    """Makes STATUSTEXT messages, and does not repeat itself."""

    def __init__(self) -> None:
        self._number = 0
        self._sent: OrderedDict[tuple[str, str], float] = OrderedDict()

    def pieces(self, severity: int, text: str, now: float, to: str = "") -> list[Message]:
        """The messages of a text; none where the same was just said there.

        Args:
            severity: of `MAV_SEVERITY`.
            text: what is said; other letters than ASCII become question marks.
            now: the time [s].
            to: the station that gets it; empty for all.
        """
        last = self._sent.get((to, text))
        if last is not None and now - last < AGAIN:
            return []
        self._sent[to, text] = now
        self._sent.move_to_end((to, text))
        while len(self._sent) > _REMEMBERED:
            self._sent.popitem(last=False)
        raw = " ".join(text.split()).encode("ascii", "replace")
        if len(raw) > _LONGEST:
            raw = raw[: _LONGEST - 3] + b"..."
        if len(raw) <= PIECE:
            return [mavlink.MAVLink_statustext_message(severity, raw)]
        self._number = self._number % 0xFFFF + 1
        parts = [raw[at : at + PIECE] for at in range(0, len(raw), PIECE)]
        if len(parts[-1]) == PIECE:
            # A full one does not say that it is the last; QGroundControl shows an empty one as " ... ".
            parts.append(b" ")
        return [
            mavlink.MAVLink_statustext_message(severity, part, self._number, index) for index, part in enumerate(parts)
        ]


def words_of(error: MkError) -> str:
    """The text of an error for a ground station."""
    if not isinstance(error, CommandRejectedError):
        return str(error)
    return f"{error.reason} {REMEDIES.get(error.token, error.fix)}".strip()


def text_of(event: object) -> tuple[int, str] | None:
    """Severity and words of an event; None for one that is not sent: a command has its answer."""
    line = line_of(event)
    if line is None or line.sort is Sort.PROCEDURE:
        return None
    severity = _SEVERITIES.get(line.tone, INFO if line.sort is Sort.LOG else NOTICE)
    return CRITICAL if line.sort is Sort.FAILSAFE else severity, line.text
