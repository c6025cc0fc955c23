"""Identity of the boards: learned from their frames, and dropped at every sign of other boards. Pure.

Such signs are text that a board prints while it boots, a long silence, a NaviCtrl that lost its FlightCtrl, and time in
which this program did not run. A FlightCtrl prints 628 characters while it boots, in stages over 4.7 s, keeps the first
stick frame it receives meanwhile and obeys it afterwards. Source: docs/firmware-notes, "Receiving", "External control".
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from mkdaemon.clock import Clock, SleepWatch
from mkdaemon.link.session.knownflight import FlightChange, FlightMemory, KnownFlight
from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.steering import Steering
from mkdaemon.link.session.verdict import HeldFinding
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.refusals import Token, refuse

LOOK: Final = 0.05
"""Period at which the evidence is weighed [s]: a tenth of the half second that a verdict may take."""
NOTICED: Final = 2 * LOOK
"""A shorter time between two looks is ordinary lateness [s]."""


@dataclass(frozen=True, slots=True)
class Standstill:
    """What was missed.

    Attributes:
        stopped: time that passed on the monotonic clock [s].
        slept: time that it did not count [s].
    """

    stopped: float
    slept: float


class StandstillWatch:
    """Tells how long nothing ran."""

    def __init__(self, clock: Clock) -> None:
        self._sleep = SleepWatch(clock)
        self._seen_at = clock.now()

    def begin(self, now: float) -> None:
        """Begin to look; what was before does not count."""
        self._seen_at = now
        self._sleep.take()

    def take(self, now: float) -> Standstill | None:
        """Return how long nothing ran until now [s]; None where that is nothing to speak of."""
        stopped, self._seen_at = now - self._seen_at, now
        slept = self._sleep.take()
        return Standstill(stopped, slept) if max(stopped, slept) > NOTICED else None


GAP: Final = 1.05
"""A silence or a standstill of this program longer than this may have been a reboot, or an exchange of the aircraft,
which takes longer by hand [s]. A lease has ended by then (`control.flightwatch`): no flight ends because of this."""
BOOT_TIME: Final = 8.0
"""Text within this time of the first belongs to the same boot [s]; a FlightCtrl boots in 4.7 s."""
_SHORTEST: Final = 8
"""Fewer characters are the rest of a broken frame."""
_FEWEST: Final = 3
"""Fewer characters that no frame has are those of a short frame that lost its `#`: an answer to a link test has ten."""
_SHARE: Final = 0.1
"""Part of the characters that no frame has: boot text has spaces, digits and line breaks, and noise few [characters
each]; tuned on the text of genuine firmware and on frames with 5 % of their bytes damaged or lost."""
_PAYLOAD: Final = frozenset(range(0x3D, 0x7D))
_OF_WORK: Final = re.compile(rb"(Timer2|I2C|FAT16|SDC|SSC) (de)?init|(kml|gpx)-file")
"""What a NaviCtrl prints while it works, in flight too: its camera servos stop and start with every hiccup of its SPI
bus, a silent compass, its card. One that boots prints other lines as well, "UART1 init...ok" first. Source: NaviCtrl
0.24, every call of `UART1_PutString` from the main loop; docs/firmware-notes, "A NaviCtrl 0.24 in flight"."""


def is_printed(raw: bytes) -> bool:
    """Whether bytes outside any frame were printed by a board, and are not what is left of a broken frame."""
    words = raw.strip(b" \r\n\t\0")
    foreign = sum(1 for code in words if code not in _PAYLOAD)
    readable = all(0x20 <= code < 0x7F or code in b"\r\n\t" for code in words)
    return len(words) >= _SHORTEST and readable and foreign >= max(_FEWEST, _SHARE * len(words))


def is_of_boot(raw: bytes) -> bool:
    """Whether a board printed bytes outside any frame because it boots."""
    return is_printed(raw) and _OF_WORK.search(raw) is None


class RebootWatch:
    """Decides when the boards must be identified again."""

    def __init__(self, peers: Peers) -> None:
        self._peers = peers
        self._text_at = -math.inf

    def text_received(self, raw: bytes, now: float) -> bool:
        """Note text between frames; returns whether a board prints it by itself."""
        return is_of_boot(raw) and self._peers.redirected is None and not self._peers.caused_silence(now, now)

    def begins(self, now: float) -> bool:
        """Note a sign; returns whether it is the first one of a boot."""
        is_first = now - self._text_at > BOOT_TIME
        if is_first:
            self._text_at = now
        return is_first

    def board_named_itself(self) -> None:
        """A version reply came: what is printed from now on belongs to another boot."""
        self._text_at = -math.inf

    def was_gap(self, verdict: HeldFinding, now: float) -> bool:
        """Whether the line has been silent for this time under this verdict, and not caused by us."""
        is_long = verdict.is_outage and now - verdict.silent_since > GAP
        return is_long and not self._peers.caused_silence(verdict.silent_since, now)


class Identity:
    """What is known of the boards, and the releases that each change of it owes.

    Attributes:
        flight: what is kept of the flight under way.
    """

    def __init__(self, peers: Peers, steering: Steering) -> None:
        """Nothing is known."""
        self._peers = peers
        self._steering = steering
        self._reboots = RebootWatch(peers)
        self._changed = True
        self.flight = KnownFlight(peers)

    def take_change(self) -> bool:
        """Whether the dialect changed since the last call."""
        changed, self._changed = self._changed, False
        return changed

    def port_opened(self) -> None:
        """The aircraft must be identified again."""
        self._peers.restart()
        self.flight.port_opened()
        self._changed = True

    def version_received(self, board: Board, message: WireMessage, now: float) -> None:
        """A board named itself."""
        self._peers.version_received(board, message, now)
        self._reboots.board_named_itself()

    def learn(self, board: Board, message: WireMessage | Unknown, now: float) -> None:
        """Take what a message tells about the firmware."""
        layout = self._peers.dialect.extern_control
        if self._peers.learn(board, message):
            self._dialect_changed(layout, now)

    def telemetry_received(self, message: WireMessage, now: float) -> bool:
        """Take a look at the flight; returns whether the boards must be identified again."""
        change = self.flight.telemetry_received(message, now)
        if change is FlightChange.SAME_FLIGHT:
            self._recall(now)
        if change is not FlightChange.FLIGHTCTRL_LOST or self._peers.dialect.fc_release is None:
            return False
        self._peers.forget_flightctrl()
        self._release_forgotten("the NaviCtrl has lost its FlightCtrl", now)
        return True

    def confirm_memory(self, now: float) -> FlightMemory:
        """Speak to the FlightCtrl as before, because a client says that it is the same; returns what was confirmed.

        Raises:
            CommandRejectedError: `nothing_remembered`.
        """
        memory = self.flight.offer(now)
        if memory is None:
            raise refuse(Token.NOTHING_REMEMBERED)
        self._recall(now)
        return memory

    def is_boot_text(self, raw: bytes, now: float) -> bool:
        """Whether text between frames is what a board prints while it boots."""
        return self._reboots.text_received(raw, now)

    def board_boots(self, now: float) -> bool:
        """A board boots; returns whether this is the first sign of it."""
        is_first = self._reboots.begins(now)
        if is_first:
            self.flight.board_boots()
            self.forget("a board boots", now)
        return is_first

    def was_gap(self, verdict: HeldFinding, now: float) -> bool:
        """Whether the line has been silent under this verdict long enough that the boards may be others."""
        return self._reboots.was_gap(verdict, now)

    def telemetry_is_back(self, before: HeldFinding, now: float) -> bool:
        """The line was silent until now; returns whether the boards must be identified again."""
        if self.was_gap(before, now):
            self.forget("telemetry is back after a gap", now)
        return now - before.silent_since > GAP

    def stood_still(self, lost: Standstill, now: float) -> bool:
        """This program did not run for a while; returns whether other boards may be there since."""
        if lost.slept > GAP:
            self.flight.machine_slept(lost.slept)
        elif lost.stopped <= GAP:
            return False
        self.forget(f"this program did not run for {max(lost.stopped, lost.slept):.1f} s", now)
        return True

    def forget(self, reason: str, now: float) -> None:
        """Other boards may be there now, or the same ones with an old stick frame: release, and identify them again."""
        self._peers.forget()
        self._release_forgotten(reason, now)

    def _release_forgotten(self, reason: str, now: float) -> None:
        self._changed = True
        self._steering.forget_command()
        self._steering.release(reason, now)

    def _recall(self, now: float) -> None:
        memory, layout = self.flight.memory, self._peers.dialect.extern_control
        assert memory is not None
        self._peers.recall_flightctrl(memory.evidence)
        self._dialect_changed(layout, now)

    def _dialect_changed(self, layout: type[WireMessage] | None, now: float) -> None:
        self._changed = True
        if self._peers.dialect.extern_control not in (None, layout):
            # The release of the opening went out in the layout that is safe everywhere but not understood everywhere.
            self._steering.release("external control layout known", now)
