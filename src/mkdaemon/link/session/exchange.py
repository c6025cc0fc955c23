"""Exchange with the port: bytes in, frames out, and the errors that end it.

Frame in: bytes, `FrameDecoder.feed`, `MessageDecoder.decode`, `Dialogue.frame_received`, `LinkSink.received`: a
straight line without a queue. Frame out: `Dialogue.poll` gives what may be written now; a timer asks again in time.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import partial
from typing import Any, Final

from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import LinkError, LinkLostError, RequestTimeoutError
from mkdaemon.link.ports.port import Port, parse_address
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.link.session.guarding import GuardFeed, LineGuard
from mkdaemon.link.session.identity import LOOK, StandstillWatch
from mkdaemon.link.session.questions import Outcome, QuestionAnswered, Unanswered
from mkdaemon.link.session.release import shortest_release
from mkdaemon.link.session.reopening import BaudSearch
from mkdaemon.link.session.reporter import Reporter
from mkdaemon.link.session.scheduler import QueuedTransmission
from mkdaemon.link.session.streamkinds import KINDS
from mkdaemon.link.session.traffic import LineTap, LinkSink, Lost, Purpose, Received, ReleaseResult, Sent
from mkdaemon.protocol.boards import Board, Direction
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import DropReason, Frame, FrameDecoder
from mkdaemon.protocol.wire import WireMessage
from mkdaemon.telemetry.control import ReleaseOutcome
from mkdaemon.telemetry.link import LinkCondition

TURN_BYTES: Final = 256
"""Bytes decoded in one turn of the loop: 45 ms of the line at 57600 baud, and 42 frames at most: the shortest has 6."""
STICK_LOOK: Final = 0.005
"""Time between two looks at a stick frame that has not left [s]."""
EXIT_TIME: Final = 0.6
"""Longest time an orderly exit may take [s]."""
EXIT_LOOK: Final = 0.02
"""Longest wait for bytes between two looks at the release of an exit [s]."""
CLOSED: Final = "closed by us"
"""Reason of an orderly end."""
Answer = asyncio.Future[WireMessage | None]
"""Of a question: its answer; None where it was sent and none ever comes."""
Discovery = Callable[[], Coroutine[Any, Any, None]]
"""Identifies the boards whenever `needs_discovery` is set; runs for ever."""


class Waiters:
    """All waiting callers."""

    def __init__(self) -> None:
        self._releases: list[asyncio.Future[ReleaseResult]] = []

    def for_answer(self) -> Answer:
        """Return what a caller waits on for an answer; hand it to the dialogue as token."""
        return asyncio.get_running_loop().create_future()

    def for_release(self) -> asyncio.Future[ReleaseResult]:
        """Return what a caller waits on for the end of the release under way."""
        waiter: asyncio.Future[ReleaseResult] = asyncio.get_running_loop().create_future()
        self._releases.append(waiter)
        return waiter

    def settle(self, dialogue: Dialogue, *, is_open: bool) -> None:
        """Hand out what is known by now; without an open port an answer is lost, not late."""
        for outcome in dialogue.questions.take_finished():
            waiter = outcome.pending.token
            if isinstance(waiter, asyncio.Future) and not waiter.done():
                _resolve(waiter, outcome, is_open=is_open)
        if self._releases and not dialogue.steering.is_releasing and dialogue.steering.plan is not None:
            self.end_releases(dialogue.steering.plan.result())

    def port_lost(self, reason: str) -> None:
        """A release that waits cannot be sent now; it is the first thing sent after opening."""
        self.end_releases(ReleaseResult(ReleaseOutcome.NOT_SENT, 0, 0, reason))

    def end_releases(self, result: ReleaseResult) -> None:
        """Give the result of a release to all that wait for it."""
        waiters, self._releases = self._releases, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(result)


class StickQueue:
    """Follows the last stick frame through the queues of the port and the kernel."""

    def __init__(self) -> None:
        self._behind: int | None = None

    @property
    def is_watching(self) -> bool:
        """Whether a stick frame was written that was still waiting at the last look."""
        return self._behind is not None

    def written(self, entry: QueuedTransmission) -> None:
        """A frame was written."""
        if entry.purpose is Purpose.SETPOINT:
            self._behind = 0
        elif self._behind is not None:
            self._behind += len(entry.raw)

    def has_left(self, backlog: int) -> bool:
        """Whether the last stick frame has left, given the number of waiting bytes."""
        if self._behind is not None and backlog <= self._behind:
            self._behind = None
        return self._behind is None

    def forget(self) -> None:
        """Waiting frames were discarded, or the port was lost."""
        self._behind = None


class Exchange:
    """One port at a time, from its opening to its loss.

    Attributes:
        port: what is open; None while nothing is.
        bauds: the line rate to open the next port with.
        reporter: builds what is published.
        waiters: callers that wait for an outcome.
        needs_discovery: set when the boards must be identified again.
    """

    def __init__(
        self,
        cfg: LinkConfig,
        sink: LinkSink,
        dialogue: Dialogue,
        clock: Clock,
        guard: LineGuard | None = None,
        tap: LineTap | None = None,
    ) -> None:
        """Prepare.

        Raises:
            ConfigError: the configured port cannot exist.
        """
        self._sink, self._tap = sink, tap
        self._dialogue = dialogue
        self._clock = clock
        self._guard = GuardFeed(guard)
        self._standstill = StandstillWatch(clock)
        self._sticks = StickQueue()
        self._decoder = FrameDecoder()
        self._messages = MessageDecoder()
        self._failure: asyncio.Future[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._wakes_at = 0.0
        self._judge_at = 0.0
        self._has_ended = False
        self._opened_at = 0.0
        self.port: Port | None = None
        self.reporter = Reporter(cfg, dialogue, clock)
        scheme = parse_address(cfg.port).scheme
        self._hides_queue = scheme == "tcp"
        self.bauds = BaudSearch(cfg.baud, enabled=cfg.probe_baud and scheme == "serial")
        self.needs_discovery = asyncio.Event()
        self.waiters = Waiters()

    @property
    def is_open(self) -> bool:
        """Whether a port is open that has not failed."""
        return self.port is not None and (self._failure is None or not self._failure.done())

    # -- reading --------------------------------------------------------------------------------------------------

    async def serve(self, port: Port, discover: Discovery, arrived: bytes = b"") -> bool:
        """Read and write until the port is lost; returns whether it was a recording that ended.

        Cancelling it ends with a release.

        Args:
            port: open; closing it is the caller's.
            discover: runs beside the reading.
            arrived: what arrived already while the aircraft was asked who it is.
        """
        self.port = port
        self._decoder = FrameDecoder()
        self._failure = asyncio.get_running_loop().create_future()
        if not port.is_recording:
            self.needs_discovery.set()
        self._opened_at = self._clock.now()
        self._standstill.begin(self._opened_at)
        self._dialogue.port_opened(
            self._opened_at,
            baud=self.bauds.current,
            is_recording=port.is_recording,
            searching=self.bauds.attempt,
        )
        self.reporter.port_opened(port.name)
        if self._tap is not None:
            self._tap.port_opened(port.name, self.bauds.current, self._opened_at)
        self._guard.port_opened(port)
        self.follow_dialect()
        self._publish()
        lost = None
        try:
            self._process(arrived)
            self.pump()
            lost = await self._converse(port, discover)
        except BaseException:  # cancelled, or a defect of this program: there is no flight from now on
            if not port.is_recording:
                # In a separate task: before Python 3.11.4 a timeout within a cancelled task ends it (gh-102780).
                await asyncio.create_task(self._leave(port), name="link.leave")
            raise
        finally:
            self._stop(lost or "")
            if lost is None:
                self._guard.port_given_up()
                self._end(CLOSED, LinkCondition.CLOSED)
            else:
                self.port_lost(lost, self.bauds.attempt.condition if self.bauds.attempt else LinkCondition.DOWN)
        return self._has_ended

    async def _converse(self, port: Port, discover: Discovery) -> str:
        """Read, discover the boards, watch for failures; returns why it is over.

        However the port is lost, the tasks tell it by returning: an exception of theirs would take the place of a
        cancellation that comes at the same time, and nothing would end the link any more.
        """
        async with asyncio.TaskGroup() as tasks:
            parts = [
                tasks.create_task(_until_lost(partial(self._read, port)), name="link.read"),
                tasks.create_task(_until_lost(self._wait_for_failure), name="link.failure"),
                tasks.create_task(_until_lost(discover), name="link.discover"),
            ]
            done, _ = await asyncio.wait(parts, return_when=asyncio.FIRST_COMPLETED)
            for part in parts:
                part.cancel()
        lost = next((part.result() for part in parts if part in done), None)
        if lost is not None:
            return lost
        self._has_ended = True
        return f"the recording {port.name} has ended"

    async def _read(self, port: Port) -> None:
        """Take bytes until there are no more: the straight line from the port to the sink."""
        while chunk := await port.read():
            for start in range(0, len(chunk), TURN_BYTES):
                if start:
                    await asyncio.sleep(0)  # setpoints and requests have their turn between two
                if self._process(chunk[start : start + TURN_BYTES]) or self._dialogue.scheduler.holds_setpoints:
                    self.pump()

    def _process(self, chunk: bytes) -> bool:
        """Take bytes; returns whether anything ended with them: a frame, or what is none."""
        now = self._clock.now()
        if self._tap is not None:
            self._tap.port_read(chunk, now)
        dialogue, sink = self._dialogue, self._sink
        dialogue.bytes_received(len(chunk), now)
        items = self._decoder.feed(chunk)
        for item in items:
            if isinstance(item, Frame):
                message = self._messages.decode(item)
                if dialogue.frame_received(item, message, now) and self.port is not None and not self.port.is_recording:
                    self.needs_discovery.set()
                sink.received(Received(now, item, message))
                for key in dialogue.streams.take_ended():
                    sink.stream_ended(key)
            else:
                if dialogue.bytes_damaged(item, now) and self.port is not None and not self.port.is_recording:
                    self.needs_discovery.set()
                sink.dropped(Lost(now, Direction.FROM_BOARD, item.reason, item.raw))
        if dialogue.difference:
            self._fail(LinkLostError(dialogue.difference))
        self.follow_dialect()  # after the portion: a recording of portions and changes tells how each frame was decoded
        return bool(items)

    def follow_dialect(self) -> None:
        """Decode as the boards speak now, and let the guard release as they listen."""
        if self._dialogue.identity.take_change():
            layouts = self._dialogue.dialect.layouts
            self._messages = MessageDecoder(layouts)
            if self._tap is not None:
                self._tap.layouts_changed(layouts, self._clock.now())
            self._guard.dialect_changed(self._dialogue.dialect.extern_control)

    async def _wait_for_failure(self) -> None:
        """End the conversation when writing failed or the line rate is wrong."""
        assert self._failure is not None
        await self._failure

    async def _leave(self, port: Port) -> None:
        """Release the aircraft and end its streams; bounded, and the port may be gone already."""
        dialogue = self._dialogue
        dialogue.steering.leave(self._clock.now())
        with suppress(LinkError, TimeoutError):
            async with asyncio.timeout(EXIT_TIME):
                self.pump()
                while dialogue.steering.is_releasing:
                    try:
                        async with asyncio.timeout(EXIT_LOOK):
                            chunk = await port.read()
                    except TimeoutError:
                        chunk = b""
                    self._process(chunk)
                    self.pump()
                for entry in last_words(dialogue, self._clock.now()):
                    self._write(port, entry)
                    await asyncio.sleep(dialogue.rules.wire_time(entry.raw) + dialogue.rules.gap)
                await port.drain()

    # -- writing --------------------------------------------------------------------------------------------------

    def pump(self) -> None:
        """Write what may be written now, settle what ended, judge and report, and set the timer for the rest."""
        now = self._clock.now()
        port = self.port
        if port is None:
            self._settle()
            return
        lost = self._standstill.take(now)
        if lost is not None and not port.is_recording and self._dialogue.stood_still(lost, now):
            self.needs_discovery.set()
            self.follow_dialect()
        try:
            self._look_after_sticks(port, now)
            for entry in self._dialogue.poll(now):
                self._write(port, entry)
        except LinkLostError as error:
            self._fail(error)
            return
        self._guard.settle(self._dialogue.steering)
        self._settle()
        if now >= self._judge_at:
            self._judge(port, now)
        look = now + STICK_LOOK if self._dialogue.scheduler.holds_setpoints else math.inf
        self._wake(min(self._dialogue.next_time(now), self._judge_at, look), now)

    def _write(self, port: Port, entry: QueuedTransmission) -> None:
        """Write one frame, and report it to the listeners.

        Raises:
            LinkLostError: the port is lost.
        """
        port.write(entry.raw)
        self._sticks.written(entry)
        self._guard.written(entry)
        self.note_written(entry.raw, entry.message, entry.purpose)

    def note_written(self, raw: bytes, message: WireMessage | None, purpose: Purpose) -> None:
        """Record and publish what was written."""
        now = self._clock.now()
        if self._tap is not None:
            self._tap.port_written(raw, now, purpose.name.lower())
        self._sink.sent(Sent(now, raw, message, purpose))

    def _look_after_sticks(self, port: Port, now: float) -> None:
        """Let no stick frame wait behind another in the kernel; throw away what waits there when a release begins.

        A serial server acknowledges what it has not sent: there none is written that may wait in it.

        Raises:
            LinkLostError: what waits can only be thrown away with the connection.
        """
        is_waiting = self._sticks.is_watching and not self._sticks.has_left(port.backlog)
        if is_waiting and self._dialogue.steering.is_releasing:
            is_waiting = False
            self._sticks.forget()
            self._dialogue.scheduler.resynchronise()
            port.discard()
        may_wait = self._hides_queue and self._dialogue.health.may_stand_still(now)
        self._dialogue.scheduler.holds_setpoints = is_waiting or may_wait

    def _settle(self) -> None:
        """Give answers, refusals and losses to the waiting callers."""
        self.waiters.settle(self._dialogue, is_open=self.is_open)
        for entry in self._dialogue.take_discarded():
            now = self._clock.now()
            self._sink.dropped(Lost(now, Direction.TO_BOARD, DropReason.EXPIRED, entry.raw))

    def _fail(self, error: LinkLostError) -> None:
        """End the conversation; every present and later wait for an answer ends at once."""
        if self._failure is not None and not self._failure.done():
            self._failure.set_exception(error)
            self._dialogue.questions.port_lost(str(error))
            self._settle()

    def _judge(self, port: Port, now: float) -> None:
        """Weigh the evidence, report, and act on a verdict that needs the port closed."""
        self._judge_at = max(self._judge_at + LOOK, now + LOOK / 2)
        health = self._dialogue.health
        health.port_backlog(port.backlog, now)
        before = health.verdict
        changed = health.judge(now)
        if changed and self._dialogue.condition_changed(before, now):
            self.needs_discovery.set()
            self.follow_dialect()
        if self.reporter.health_is_due(now) or changed:
            self._publish()
        if self.reporter.traffic_is_due(now):
            self._sink.traffic_counted(self.reporter.traffic(now))
        why = self.bauds.reason_to_reopen(health.verdict, self._opened_at, now)
        if why is not None:
            self._fail(LinkLostError(why))

    def _publish(self) -> None:
        now = self._clock.now()
        if self.reporter.take_state_change():
            self._sink.state_changed(self.reporter.state(now))
        self._sink.health_measured(self.reporter.health(now))

    def port_lost(self, reason: str, condition: LinkCondition = LinkCondition.DOWN) -> None:
        """Say at once that the port is gone, and why."""
        self._guard.port_lost()
        self._end(reason, condition)

    def _end(self, reason: str, condition: LinkCondition) -> None:
        self.port = None
        self._sticks.forget()
        self._dialogue.port_lost(self._clock.now(), reason, condition)
        self._settle()
        self.waiters.port_lost(reason)
        self._publish()
        self._sink.traffic_counted(self.reporter.traffic(self._clock.now()))

    def _wake(self, at: float, now: float) -> None:
        """Have `pump` called at a time [s]; mostly that is when it would be called already."""
        if self._timer is not None:
            if at == self._wakes_at:
                return
            self._timer.cancel()
        self._wakes_at = at
        self._timer = asyncio.get_running_loop().call_later(max(at - now, 0.0), self._woken)

    def _woken(self) -> None:
        self._timer = None
        self.pump()

    def _stop(self, reason: str) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._failure is not None and not self._failure.done():
            self._failure.cancel()
        now = self._clock.now()
        if self._tap is not None:
            self._tap.port_lost(reason, now)
        for item in self._decoder.flush():
            if not isinstance(item, Frame):
                self._dialogue.bytes_damaged(item, now)
                self._sink.dropped(Lost(now, Direction.FROM_BOARD, item.reason, item.raw))


def last_words(dialogue: Dialogue, now: float) -> list[QueuedTransmission]:
    """Return what is said when the aircraft is released: a FlightCtrl of the fork never ends its debug stream.

    Older ones do, after 4.1 s, and their dead-man is refreshed by the request: they are not asked. A release follows.
    """
    plan, layout, dead_man = dialogue.steering.plan, dialogue.dialect.extern_control, dialogue.dialect.dead_man
    is_released = plan is not None and plan.outcome is ReleaseOutcome.CONFIRMED
    is_endless = dialogue.peers.direct is Board.FC and not dead_man.refreshed_by("d")
    if not is_endless or not is_released or "debug" not in dialogue.streams.wanted:
        return []
    stop = KINDS["debug"].ask(0)
    frames = [(Purpose.SUBSCRIPTION, stop), *((Purpose.RELEASE, frame) for frame in shortest_release(layout))]
    entries = [QueuedTransmission(frame.to_frame(Board.FC), why, now + 1.0, Board.FC, frame) for why, frame in frames]
    for entry in entries:
        dialogue.counters.sent(entry)
    return entries


async def _until_lost(part: Callable[[], Coroutine[Any, Any, None]]) -> str | None:
    """Run a part of the conversation; returns why the port is lost, None where the part has come to its end."""
    try:
        await part()
    except LinkLostError as lost:
        return str(lost)
    return None


def _resolve(waiter: Answer, outcome: Outcome, *, is_open: bool) -> None:
    match outcome:
        case QuestionAnswered():
            waiter.set_result(outcome.answer)
        case Unanswered():
            waiter.set_exception((RequestTimeoutError if is_open else LinkLostError)(outcome.reason))
