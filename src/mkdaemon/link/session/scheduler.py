"""The transmit scheduler: what goes on the wire next, and when. Pure; driven with `now`.

Order: release, setpoint, retries, requests, subscriptions, echo, background. A setpoint replaces the older one in
place. One request of a kind and board is outstanding at a time, because boards have one slot (NaviCtrl) or one
receive buffer (FlightCtrl). Nothing is written ahead of the wire: a frame is given out when the line is free, so the
newest setpoint never waits behind bytes already handed over. Source: docs/firmware-notes, "Losses".

A FlightCtrl loses a frame that comes too soon after another, and a radio delivers frames closer together than they
were sent. So a request to it keeps the gap of the rules on both sides, and by radio a longer `distance` from the frame
before. Where setpoints come too often for that, setpoints wait until the request has left. The one that waited follows
it if the next one can still leave in its time; else the request has taken its place, and the next one replaces it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mkdaemon.link.session.line import FORWARDING_GAP, RESYNC, LineRules
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.wire import Board, WireMessage

QUEUE_LIMIT: Final = 64
"""Entries waiting per purpose; more means that a caller does not look at the answers."""
PATIENCE_TIME: Final = {
    Purpose.RETRY: 0.03,
    Purpose.REQUEST: 0.03,
    Purpose.SUBSCRIPTION: 0.1,
    Purpose.ECHO: 0.05,
    Purpose.BACKGROUND: 0.2,
}
"""How long an entry lets the next expected setpoint pass first, before it takes its turn all the same [s]."""
REQUESTS: Final = tuple(PATIENCE_TIME)
"""What is no stick frame, in the order in which it is sent."""
AFTER_SETPOINT: Final = 0.0015
"""How long after the expected setpoint an entry looks again: setpoints come with some jitter [s]."""
SLOWEST_SETPOINT: Final = 0.25
"""Setpoints further apart have no rhythm worth keeping the line free for [s]."""
CATCH_UP: Final = 0.7
"""Part of the setpoint interval by which a late setpoint may be followed sooner, the gap kept; a FlightCtrl loses none
at 100 Hz with 3 ms of jitter, a NaviCtrl that passes them on has no such margin."""
CREEP: Final = 0.97
"""Part of the setpoint interval that is kept on average, so that setpoints that come exactly as often as allowed do not
stay late once they were: 103 Hz at most, where a FlightCtrl loses none up to 150 Hz without jitter."""
BETWEEN: Final = 2
"""Setpoints that go out between two requests that each take the place of one."""
SETPOINT_TIME: Final = 0.004
"""Time of a setpoint on the wire [s]: 22 characters."""
BOTH_FRAMES: Final = 0.006
"""Time of a setpoint and of a request on the wire [s]: 22 and 10 characters."""
RESYNC_AFTER: Final = 2.0
"""After this silence on our side the next frame is led by CR CR: noise may have left a `#` in a receiver [s]."""


@dataclass(slots=True, eq=False)
class QueuedTransmission:
    """One transmission waiting for its turn.

    Attributes:
        raw: the bytes.
        purpose: decides the order.
        deadline: not sent after this [s].
        board: who acts on it.
        message: what it says; None for bytes that are no frame.
        reaches_fc: a FlightCtrl receives it: directly, redirected or passed on.
        slot: (board, reply letter) that may be outstanding only once; None where no reply is awaited.
        reply_within: how long the slot stays taken without a reply [s].
        not_before: earliest time [s].
        queued: when it was handed in [s].
        tag: the caller's handle.
    """

    raw: bytes
    purpose: Purpose
    deadline: float
    board: Board = Board.ANY
    message: WireMessage | None = None
    reaches_fc: bool = False
    slot: tuple[Board, str] | None = None
    reply_within: float = 0.25
    not_before: float = 0.0
    queued: float = 0.0
    tag: object = None


class TransmitScheduler:
    """Gives out one frame at a time, when the line and the boards can take it.

    While it `holds_setpoints`, the newest one waits here, because an earlier one has not left the machine.

    Attributes:
        distance: idle line between a frame and a request that follows it to a FlightCtrl, where the radio asks for
            more than the gap of the rules [s]; 0 by cable.
    """

    def __init__(self, rules: LineRules) -> None:
        self.rules = rules
        self._queues: dict[Purpose, deque[QueuedTransmission]] = {purpose: deque() for purpose in Purpose}
        self._taken: dict[tuple[Board, str], float] = {}
        self._line_free = 0.0
        self._fc_free = 0.0
        self._fc_end = -math.inf
        self._setpoints_since = BETWEEN
        self.distance = 0.0
        self._last_end: float | None = None
        self._setpoint_turn = 0.0
        self._passed_on = 0.0
        self._arrived: float | None = None
        self._setpoint_period: float | None = None
        self._needs_resync = True
        self._deaf: dict[Board, float] = {}
        self._refreshes: Callable[[str], bool] | None = None
        self._quiet_until = 0.0
        self._leaving = False
        self._only: Board | None = None
        self._expired: list[QueuedTransmission] = []
        self.holds_setpoints = False

    # -- what callers hand in -------------------------------------------------------------------------------------

    def submit(self, entry: QueuedTransmission, now: float) -> bool:
        """Queue an entry; False when its queue is full. A setpoint replaces the one waiting."""
        queue = self._queues[entry.purpose]
        entry.queued = now
        if entry.purpose is Purpose.SETPOINT:
            self._expired.extend(queue)
            queue.clear()
            self._learn_period(now)
            if self._setpoints_since == 0 and self._fc_free > now + AFTER_SETPOINT:
                self._let_newer_replace(entry, now)
        elif len(queue) >= QUEUE_LIMIT:
            return False
        queue.append(entry)
        return True

    def withdraw(self, tag: object) -> None:
        """Take back what was queued under this handle and not sent yet."""
        for queue in self._queues.values():
            for entry in [entry for entry in queue if entry.tag is tag]:
                queue.remove(entry)

    def drop_setpoint(self) -> None:
        """Forget the waiting setpoint and the rhythm they came in."""
        self._queues[Purpose.SETPOINT].clear()
        self._setpoint_period = self._arrived = None

    def clear(self) -> list[QueuedTransmission]:
        """Forget everything waiting, for example because the port was lost; returns it."""
        left = [entry for queue in self._queues.values() for entry in queue]
        for queue in self._queues.values():
            queue.clear()
        self._taken.clear()
        self._deaf.clear()
        self._only = None
        self._leaving = False
        self._setpoint_period = self._arrived = None
        self._setpoint_turn = self._passed_on = 0.0
        self._line_free = self._fc_free = 0.0
        self._fc_end = -math.inf
        self._setpoints_since = BETWEEN
        self.distance = 0.0
        self._last_end = None
        self._needs_resync = True
        return left

    def reply_seen(self, board: Board, letter: str) -> None:
        """A reply arrived: its kind may be asked again."""
        self._taken.pop((board, letter), None)
        self._taken.pop((Board.ANY, letter), None)

    def resynchronise(self) -> None:
        """Lead the next frame by CR CR: something went wrong, a receiver may wait inside a broken frame."""
        self._needs_resync = True

    def deafen(self, board: Board, until: float) -> None:
        """A board does not listen until then (it writes its EEPROM, beeps or boots): hold everything but releases."""
        self._deaf[board] = max(until, self._deaf.get(board, 0.0))

    def quieten(self, refreshes: Callable[[str], bool], until: float) -> None:
        """Keep requests from the FlightCtrl until then whose letters would keep an old stick command alive."""
        self._refreshes = refreshes
        self._quiet_until = until

    def end_quiet(self) -> None:
        """Let those requests pass again: the FlightCtrl confirmed that it holds no command."""
        self._quiet_until = 0.0

    def holds_back(self, letter: str, now: float) -> bool:
        """Whether a command of this letter to the FlightCtrl must wait, because it would keep a stick command alive."""
        return now < self._quiet_until and self._refreshes is not None and self._refreshes(letter)

    def send_only_releases(self) -> None:
        """Hold everything else until the port is reopened: the daemon ends."""
        self._leaving = True

    def reserve_line(self, board: Board | None) -> None:
        """While a NaviCtrl passes the line through, only entries for that board go out; None ends it."""
        self._only = board

    # -- what the writer takes ------------------------------------------------------------------------------------

    def take(self, now: float) -> QueuedTransmission | None:
        """Return the entry to write now, with CR CR in front where needed, and account for it; None to wait."""
        self._expire(now)
        if now < self._line_free:
            return None
        for queue in self._queues.values():
            for entry in queue:
                if self._ready_at(entry, now) <= now:
                    queue.remove(entry)
                    return self._give(entry, now)
        return None

    def next_time(self, now: float) -> float | None:
        """When to call `take` again; None while nothing waits."""
        times = [
            min(max(self._ready_at(entry, now), self._line_free), entry.deadline + 1e-6)
            for queue in self._queues.values()
            for entry in queue
        ]
        return max(min(times), now) if times else None

    def take_expired(self) -> list[QueuedTransmission]:
        """Return entries that were never sent: too old, or replaced by a newer setpoint."""
        expired, self._expired = self._expired, []
        return expired

    @property
    def waiting(self) -> int:
        """Entries not sent yet."""
        return sum(map(len, self._queues.values()))

    @property
    def release_waits(self) -> bool:
        """Whether a frame of a release was handed in and not sent yet."""
        return bool(self._queues[Purpose.RELEASE])

    @property
    def setpoint_period(self) -> float | None:
        """Rhythm in which setpoints come [s]; None while none do."""
        return self._setpoint_period

    # -- rules ----------------------------------------------------------------------------------------------------

    def _touches_fc(self, entry: QueuedTransmission) -> bool:
        """Whether a FlightCtrl sees the frame; before the first answer any board may be one."""
        return entry.reaches_fc or self.rules.direct is not Board.NC

    def _ready_at(self, entry: QueuedTransmission, now: float) -> float:
        """Earliest time the boards can take this entry; infinite while something else must end first."""
        touches_fc = self._touches_fc(entry)
        ready = max(entry.not_before, self._fc_free if touches_fc else 0.0)
        if entry.purpose is Purpose.RELEASE:
            return max(ready, self._passed_on)
        if self._leaving:
            return math.inf
        if self._only is not None and entry.board is not self._only and entry.message is not None:
            return math.inf
        ready = max(ready, self._deaf.get(entry.board, 0.0))
        if touches_fc and entry.message is not None and self.holds_back(entry.message.spec.id, now):
            ready = max(ready, self._quiet_until)
        if entry.slot is not None:
            ready = max(ready, self._taken.get(entry.slot, 0.0))
        if entry.purpose is Purpose.SETPOINT:
            return math.inf if self.holds_setpoints else max(ready, self._setpoint_turn, self._given_up_for(now))
        ready = max(ready, now, self._line_free)
        if touches_fc:
            ready = max(ready, self._fc_end + self.distance)
            if self._replaces_setpoint(now):
                ready = ready if self._setpoints_since >= BETWEEN else max(ready, self._setpoints_end)
                return self._behind_setpoint(entry, ready)
        return self._let_setpoint_pass(entry, ready)

    def _replaces_setpoint(self, now: float) -> bool:
        """Whether setpoints come too often for a request to keep its distance between two."""
        gap = self.rules.gap_after(reaches_fc=True)
        needed = max(gap, self.distance) + gap + BOTH_FRAMES
        return self._expect_setpoint(now) is not None and (self._setpoint_period or 0.0) < needed

    def _behind_setpoint(self, entry: QueuedTransmission, begin: float) -> float:
        """Let a request wait for the next setpoint, within its patience, where that has no setpoint replaced [s]."""
        expected = self._expect_setpoint(begin)
        if expected is None or self._setpoint_period is None or self.holds_setpoints:
            return begin
        if self._queues[Purpose.SETPOINT]:
            expected = max(expected, begin)
        gap = self.rules.gap_after(reaches_fc=True)
        request, setpoint = self.rules.wire_time(entry.raw) + gap, SETPOINT_TIME + gap
        limit = expected + self._setpoint_period + AFTER_SETPOINT
        ends = max(begin + request, expected) + setpoint
        ends_behind = expected + SETPOINT_TIME + max(gap, self.distance) + request + setpoint
        if not ends_behind - self._setpoint_period <= limit < ends:
            return begin
        return max(begin, min(expected + AFTER_SETPOINT, entry.queued + PATIENCE_TIME[entry.purpose]))

    @property
    def _setpoints_end(self) -> float:
        """When a rhythm that goes on no more counts as ended [s]."""
        assert self._arrived is not None
        assert self._setpoint_period is not None
        return self._arrived + 2.0 * self._setpoint_period + 1e-6

    def _given_up_for(self, now: float) -> float:
        """When setpoints may go on after the request that takes the place of one [s]; 0 where none waits for that."""
        if self._setpoints_since < BETWEEN or not self._replaces_setpoint(now):
            return 0.0
        latest = max(now, self._fc_free, self._fc_end + self.distance) + 1e-9
        for purpose in REQUESTS:
            for entry in self._queues[purpose]:
                if self._touches_fc(entry) and (at := self._ready_at(entry, now)) <= latest:
                    return at + self.rules.wire_time(entry.raw) + self.rules.gap_after(reaches_fc=True)
        return 0.0

    def _let_setpoint_pass(self, entry: QueuedTransmission, begin: float) -> float:
        """Do not begin a frame that would hold up the next setpoint, within the entry's patience."""
        expected = self._expect_setpoint(begin)
        if expected is None:
            return begin
        gap = self.rules.gap_after(reaches_fc=entry.reaches_fc)
        busy = self.rules.wire_time(entry.raw) + (max(gap, self.distance) if self._touches_fc(entry) else gap)
        if begin + busy <= expected:
            return begin
        return max(begin, min(expected + AFTER_SETPOINT, entry.queued + PATIENCE_TIME[entry.purpose]))

    def _expect_setpoint(self, begin: float) -> float | None:
        """When the next setpoint will want the line; None without a stream of setpoints."""
        if self._setpoint_period is None or self._arrived is None:
            return None
        if self._queues[Purpose.SETPOINT]:
            return self._setpoint_turn
        expected = self._arrived + self._setpoint_period
        if begin > expected + self._setpoint_period:
            return None  # they stopped
        return max(expected, self._setpoint_turn)

    def _learn_period(self, now: float) -> None:
        """Follow the rhythm of setpoints; a pause ends it."""
        if self._arrived is not None:
            period = now - self._arrived
            self._setpoint_period = period if period <= SLOWEST_SETPOINT else None
        self._arrived = now

    def _give(self, entry: QueuedTransmission, now: float) -> QueuedTransmission:
        silent = self._last_end is None or now - self._last_end > RESYNC_AFTER
        if entry.message is not None and (self._needs_resync or silent):
            entry.raw = RESYNC + entry.raw
            self._needs_resync = False
        end = now + self.rules.wire_time(entry.raw)
        self._line_free = self._last_end = end
        if self._touches_fc(entry):
            self._fc_end, self._fc_free = end, end + self.rules.gap_after(reaches_fc=True)
            self._take_its_place(entry, now)
        is_passed_on = self.rules.setpoint_interval >= FORWARDING_GAP
        if is_passed_on and entry.purpose in (Purpose.SETPOINT, Purpose.RELEASE):
            self._passed_on = now + FORWARDING_GAP
        if entry.purpose is Purpose.SETPOINT:
            # A setpoint that had to wait may be followed a little sooner, so that the delay does not stay.
            interval = self.rules.setpoint_interval * (1.0 if is_passed_on else CREEP)
            slack = 0.0 if is_passed_on else CATCH_UP * interval
            self._setpoint_turn = max(self._setpoint_turn, now - slack) + interval
        if entry.slot is not None:
            self._taken[entry.slot] = end + entry.reply_within
        return entry

    def _take_its_place(self, entry: QueuedTransmission, now: float) -> None:
        """Count setpoints between requests; one that waited for this request lets a newer one replace it."""
        if entry.purpose is Purpose.SETPOINT:
            self._setpoints_since += 1
        elif entry.purpose in REQUESTS:
            self._setpoints_since = 0
            for waiting in self._queues[Purpose.SETPOINT]:
                self._let_newer_replace(waiting, now)

    def _let_newer_replace(self, waiting: QueuedTransmission, now: float) -> None:
        """A setpoint that has to wait for a request, and would then hold up the next one, leaves only where none comes.

        By cable at 44 Hz the wait is 7 ms, and the next one leaves in its time; a command that is replaced is 23 ms old
        when a newer one follows.
        """
        if self._setpoint_period is None or self._arrived is None:
            return
        expected = self._arrived + self._setpoint_period
        gap = self.rules.gap_after(reaches_fc=True)
        if max(now, self._fc_free) + self.rules.wire_time(waiting.raw) + gap > expected + AFTER_SETPOINT:
            waiting.not_before = max(now, expected) + AFTER_SETPOINT

    def _expire(self, now: float) -> None:
        for queue in filter(None, self._queues.values()):
            late = [entry for entry in queue if entry.deadline < now]
            for entry in late:
                queue.remove(entry)
            self._expired.extend(late)
