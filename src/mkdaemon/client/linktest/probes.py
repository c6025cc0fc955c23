"""Every frame that wants an answer, and what became of it: link tests and stick frames. Pure.

Times are those of the daemon: when the last byte of a frame was handed to the port, and when that of its answer came.
A way over the bus is in none of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from mkdaemon.telemetry.traffic import FrameSample

TIMEOUT: Final = 0.25
"""A probe whose answer is later than this is lost [s]; the daemon counts with the same."""
RADIO_TRIP: Final = 0.025
"""A shorter median round trip is a wire's [s]; a radio's shortest way there and back takes 26 ms."""
PATTERNS: Final = (
    "rx/nc/echo",
    "rx/fc/version",
    "rx/*/control_confirm",
    "tx/nc/echo_request",
    "tx/fc/version_request",
    "tx/*/extern_control",
)
"""Keys of the frames that are followed. Answers are subscribed first: an answer that came before its subscription would
count as lost."""


class ProbeKind(StrEnum):
    """What was sent."""

    ECHO = "link test"
    """`z` to a NaviCtrl, a version request to a FlightCtrl, which has no link test."""
    CONTROL = "stick frame"
    """External control; boards that take it confirm it."""


@dataclass(frozen=True, slots=True)
class Probe:
    """One frame and its fate.

    Attributes:
        kind: what it was.
        sent: since the measurement began [s].
        trip: until its answer was there [s]; None where none came in time.
        is_replaced: none came because the board confirms only a newer one; see `Fates.replaced`.
    """

    kind: ProbeKind
    sent: float
    trip: float | None
    is_replaced: bool = False


@dataclass(slots=True)
class _Open:
    kind: ProbeKind
    sent: float
    trip: float | None = None
    is_known: bool = False
    is_replaced: bool = False


class Ledger:
    """Follows the frames of one measurement.

    Attributes:
        stick_frames: sent, whether the board confirms any or not.
    """

    def __init__(self) -> None:
        """Begin; times are counted from the first frame that is seen."""
        self.stick_frames = 0
        self._began: float | None = None
        self._latest = 0.0
        self._is_open = True
        self._all: list[_Open] = []
        self._waiting: dict[tuple[ProbeKind, Hashable], _Open] = {}
        self._overtaken: deque[_Open] = deque(maxlen=64)
        self._replaced: int | None = None

    @property
    def elapsed(self) -> float:
        """Time from the first frame to the latest one [s]."""
        return 0.0 if self._began is None else self._latest - self._began

    def take(self, suffix: str, frame: FrameSample) -> None:
        """Note a frame that went or came.

        Args:
            suffix: its key, one of `PATTERNS`.
            frame: as published; `fields` is the typed message.
        """
        now = self._latest = frame.stamp.monotonic
        if self._began is None:
            self._began = now
        message = suffix.rpartition("/")[2]
        match message:
            case "echo_request":
                self._sent(ProbeKind.ECHO, frame.fields.pattern, now)
            case "version_request" if frame.purpose == "echo":
                self._sent(ProbeKind.ECHO, None, now)
            case "extern_control" if frame.purpose == "setpoint":
                self._sent(ProbeKind.CONTROL, frame.fields.frame, now)
            case "echo":
                self._answered(ProbeKind.ECHO, frame.fields.pattern, now)
            case "version":
                self._answered(ProbeKind.ECHO, None, now)
            case "control_confirm":
                self._confirmed(frame.fields.frame, now)

    def take_replaced(self, total: int) -> None:
        """Note how many confirmations the board could not send.

        A FlightCtrl keeps one number to confirm: while it sends something else a newer number replaces the older one,
        whose frame has arrived all the same.

        Args:
            total: since the daemon's start, as `link/health` has it.
        """
        more = 0 if self._replaced is None else total - self._replaced
        self._replaced = total
        for _ in range(min(more, len(self._overtaken))):
            self._overtaken.pop().is_replaced = True

    def end(self) -> None:
        """Follow no further frame; answers to those that wait still count."""
        self._is_open = False

    def counts(self) -> tuple[int, int]:
        """Probes whose fate is known, and how many of them are lost."""
        found = self.probes()
        return len(found), sum(probe.trip is None for probe in found)

    def probes(self) -> list[Probe]:
        """All whose fate is known, in the order in which they were sent.

        Stick frames are left out where the board has not confirmed a single one: such a board confirms none.
        """
        began = self._began or 0.0
        kinds = {one.kind for one in self._all if one.trip is not None} | {ProbeKind.ECHO}
        return [
            Probe(one.kind, one.sent - began, one.trip, one.is_replaced)
            for one in self._all
            if one.kind in kinds and (one.is_known or self._latest - one.sent > TIMEOUT)
        ]

    def _sent(self, kind: ProbeKind, token: Hashable, now: float) -> None:
        if not self._is_open:
            return
        self.stick_frames += kind is ProbeKind.CONTROL
        probe = _Open(kind, now)
        self._all.append(probe)
        self._waiting[kind, token] = probe

    def _answered(self, kind: ProbeKind, token: Hashable, now: float) -> _Open | None:
        probe = self._waiting.pop((kind, token), None)
        if probe is None:
            return None
        probe.is_known = True
        if now - probe.sent <= TIMEOUT:
            probe.trip = now - probe.sent
        return probe

    def _confirmed(self, number: int, now: float) -> None:
        probe = self._answered(ProbeKind.CONTROL, number, now)
        if probe is None:
            return
        for key, older in list(self._waiting.items()):
            if key[0] is ProbeKind.CONTROL and older.sent < probe.sent:
                older.is_known = True
                self._overtaken.append(older)
                del self._waiting[key]
