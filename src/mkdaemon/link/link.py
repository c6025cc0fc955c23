"""The link: one port, read and written by one task, reopened for ever.

Frame in: bytes, `FrameDecoder.feed`, `MessageDecoder.decode`, `Dialogue.received`, `LinkSink.received`: a straight line
without a queue. Frame out: `Dialogue.poll` gives what may be written now; a timer asks again when it said so.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final, Protocol

from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError, LinkError, LinkLostError, RequestTimeoutError
from mkdaemon.link.dialogue import Dialogue
from mkdaemon.link.discovery import introduce
from mkdaemon.link.labels import LabelCache, read_labels
from mkdaemon.link.port import Port, open_port, parse_address
from mkdaemon.link.reopening import AliasMemory, BaudSearch, backoff
from mkdaemon.link.report import Reporter
from mkdaemon.link.traffic import LinkSink, Lost, Purpose, Received, ReleaseResult, Sent
from mkdaemon.link.waiters import Waiters
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.framing import Frame, FrameDecoder
from mkdaemon.protocol.wire import Board, MessageDecoder, WireMessage
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkTraffic

JUDGE_S: Final = 0.05
"""How often the evidence is weighed [s]; a twentieth of a second of the half second a verdict may take."""
FAREWELL_S: Final = 0.6
"""Longest time the release of an orderly exit may take [s]."""


class Opener(Protocol):
    """What opens a port; `open_port` in earnest, something else in tests."""

    def __call__(self, url: str, *, baud: int) -> Awaitable[Port]:
        """Open; raises what `open_port` raises."""


class Link:
    """A line to a MikroKopter that can be trusted."""

    def __init__(
        self,
        cfg: LinkConfig,
        sink: LinkSink,
        *,
        opener: Opener = open_port,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare; `run` does the work.

        Raises:
            ConfigError: the configured port cannot exist, or the line cannot carry the configured rates.
        """
        self._cfg = cfg
        self._sink = sink
        self._opener = opener
        self._clock = clock
        self._wall_offset = time.time() - clock()
        self._dialogue = Dialogue(cfg, clock())
        self._decoder = FrameDecoder()
        self._messages = MessageDecoder()
        self._port: Port | None = None
        self._broken: asyncio.Future[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._judge_at = 0.0
        self._reporter = Reporter(cfg, self._dialogue, wall_offset=self._wall_offset)
        has_rate = parse_address(cfg.port).scheme == "serial"
        self._bauds = BaudSearch(cfg.baud, enabled=cfg.probe_baud and has_rate)
        self._wants_introduction = asyncio.Event()
        self._waiters = Waiters()
        self._aliases = AliasMemory()
        self._labels = LabelCache(cfg.label_cache)
        self._has_ended = False
        self._opened_at = 0.0

    # -- what callers use -----------------------------------------------------------------------------------------

    @property
    def dialect(self) -> Dialect:
        """How to speak to this aircraft, as far as it has shown itself."""
        return self._dialogue.dialect

    @property
    def boards(self) -> frozenset[Board]:
        """Boards heard since the port was opened."""
        return frozenset(self._dialogue.peers.boards)

    @property
    def direct_board(self) -> Board:
        """The board the wire ends at; ANY while unknown."""
        return self._dialogue.peers.direct

    @property
    def is_up(self) -> bool:
        """Whether both directions work, perhaps with losses."""
        return self._reporter.is_usable

    def health(self) -> LinkHealth:
        """Everything measured about the line, now."""
        return self._reporter.health(self._clock())

    def traffic(self) -> LinkTraffic:
        """The counters, now."""
        return self._reporter.traffic(self._clock())

    def rates(self) -> dict[str, float]:
        """Interval of every wanted stream [s]."""
        return self._dialogue.streams.wanted

    async def request(
        self,
        msg: WireMessage,
        *,
        board: Board | None = None,
        timeout: float | None = None,  # noqa: ASYNC109 - of one attempt, kept by the dialogue
        retries: int | None = None,
        purpose: Purpose = Purpose.REQUEST,
    ) -> WireMessage:
        """Ask a board and return its answer.

        Args:
            msg: the question.
            board: who is asked; by default the board at the end of the wire, or the only one that understands it.
            timeout: wait for the first answer [s]; by default what this command takes.
            retries: further attempts; by default what repeating this command may do.
            purpose: REQUEST, or BACKGROUND for what nobody waits for.

        Raises:
            CommandRejectedError: the board cannot be reached, too much waits, or the message has no answer.
            RequestTimeoutError: no answer, all attempts used.
            LinkLostError: the port is not open, or was lost meanwhile.
        """
        if msg.spec.reply is None:
            raise CommandRejectedError("no_reply", f"{msg.spec.name} is never answered.", "Send it without waiting.")
        reply = await self._converse(msg, board, patience=timeout, retries=retries, purpose=purpose)
        if reply is None:
            raise RequestTimeoutError(f"{msg.spec.name}: no answer")
        return reply

    async def send(self, msg: WireMessage, *, board: Board | None = None) -> None:
        """Send a message that is never answered; returns when it is on the wire.

        Raises:
            CommandRejectedError: the board cannot be reached, or too much waits.
            LinkLostError: the port is not open, or was lost meanwhile.
        """
        await self._converse(msg, board, patience=None, retries=0, purpose=Purpose.REQUEST)

    def send_setpoint(self, msg: WireMessage, *, deadline: float) -> None:
        """Hand in an external control frame; the newest wins, and none leaves after its deadline.

        Args:
            msg: in the layout `dialect.extern_control`; its frame number is set here.
            deadline: [s; the link's clock].

        Raises:
            CommandRejectedError: `link_down`, `read_only`, `wrong_layout` or `releasing`.
        """
        self._dialogue.steer(msg, deadline, self._clock())
        self._pump()

    async def release(self, reason: str) -> ReleaseResult:
        """Let go of the aircraft: neutral sticks, then Config = 0 five times, confirmed where that is possible.

        Setpoints are refused until this is done. Never raises; without an open port the release is what goes out
        first after the next opening.
        """
        if self._port is None or self._port.is_recording:
            return ReleaseResult("not_sent", 0, 0, reason)
        self._dialogue.release(reason, self._clock())
        waiter = self._waiters.for_release()
        self._pump()
        return await waiter

    async def labels(self, board: Board) -> tuple[str, ...]:
        """Names of a board's 32 debug channels, kept by firmware.

        Raises:
            CommandRejectedError: the board cannot be reached.
            RequestTimeoutError: it did not answer.
            LinkLostError: the port is not open, or was lost meanwhile.
        """
        return await read_labels(self, board, self._labels)

    def set_rate(self, kind: str, interval_s: float) -> None:
        """Change the interval of a stream [s]; 0 ends it.

        Raises:
            CommandRejectedError: no such stream, or the line cannot carry it; with the arithmetic.
        """
        self._dialogue.want(kind, interval_s)
        self._pump()

    # -- what discovery uses --------------------------------------------------------------------------------------

    def begin_streams(self) -> None:
        """Ask for the configured streams."""
        self._dialogue.start_streams()
        self._pump()

    def motors_known_off(self) -> bool:
        """Whether fresh telemetry says that the motors stand still."""
        return self._dialogue.peers.motors_known_off(self._clock())

    def note_redirect(self, board: Board | None) -> None:
        """A NaviCtrl passes the line through to a board from now on; None: no more."""
        self._dialogue.redirect(board)
        self._pump()

    async def send_escape(self) -> None:
        """Send the sequence that ends a redirection."""
        self._dialogue.escape(self._clock())
        self._pump()

    # -- running --------------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Open, read, write, and open again whenever the port is lost; ends only with a recording.

        Cancelling it ends with a release.

        Raises:
            LinkError: the port could not be opened the first time, and `wait_for_port` is off.
            ConfigError: no such port can ever be opened.
        """
        has_been_open = self._cfg.wait_for_port
        delays = backoff(self._cfg.reopen_min_s, self._cfg.reopen_max_s)
        while True:
            try:
                port = await self._open()
            except LinkError as error:
                missing = isinstance(error, LinkLostError)
                self._note_loss(str(error), LinkCondition.ABSENT if missing else LinkCondition.DOWN)
                if not has_been_open:
                    raise
                await asyncio.sleep(next(delays))
                continue
            has_been_open = True
            try:
                if await self._serve(port):
                    return
            finally:
                self._port = None
                await port.close()
            delays = backoff(self._cfg.reopen_min_s, self._cfg.reopen_max_s)
            await asyncio.sleep(next(delays))

    async def _open(self) -> Port:
        url = self._cfg.port
        try:
            port = await self._opener(url, baud=self._bauds.current)
        except LinkLostError:
            alias = self._aliases.find(url)
            if alias is None:
                raise
            return await self._opener(alias, baud=self._bauds.current)
        self._aliases.learn(url)
        return port

    async def _serve(self, port: Port) -> bool:
        """Read and write until the port is lost; returns whether it was a recording that ended."""
        self._port = port
        self._decoder = FrameDecoder()
        self._broken = asyncio.get_running_loop().create_future()
        if not port.is_recording:
            self._wants_introduction.set()
        self._opened_at = self._clock()
        self._dialogue.opened(
            self._opened_at,
            baud=self._bauds.current,
            is_recording=port.is_recording,
            searching=(self._bauds.condition, self._bauds.attempt) if self._bauds.attempt else None,
        )
        self._reporter.port_opened(port.name)
        self._publish()
        reason = "closed by us"
        try:
            self._pump()
            reason = await self._talk(port)
        except asyncio.CancelledError:
            await self._farewell(port)
            raise
        finally:
            self._stop()
            self._note_loss(reason, self._bauds.condition if self._bauds.attempt else LinkCondition.DOWN)
        return self._has_ended

    async def _talk(self, port: Port) -> str:
        """Read, introduce ourselves, watch for failures; returns why it is over."""
        reason = ""
        try:
            async with asyncio.TaskGroup() as tasks:
                reader = tasks.create_task(self._read(port), name="link.read")
                others = [
                    tasks.create_task(self._introduce(), name="link.introduce"),
                    tasks.create_task(self._watch(), name="link.watch"),
                ]
                await reader
                for task in others:
                    task.cancel()
            self._has_ended = True
            reason = f"the recording {port.name} has ended"
        except* LinkLostError as lost:
            reason = str(lost.exceptions[0])
        return reason

    async def _read(self, port: Port) -> None:
        """Take bytes until there are no more: the straight line from the port to the sink."""
        while chunk := await port.read():
            self._take(chunk)
            self._pump()

    def _take(self, chunk: bytes) -> None:
        now = self._clock()
        wall = now + self._wall_offset
        dialogue, sink = self._dialogue, self._sink
        dialogue.arrived(len(chunk), now)
        for item in self._decoder.feed(chunk):
            if isinstance(item, Frame):
                message = self._messages.decode(item)
                dialogue.received(item, message, now)
                if dialogue.take_dialect_change():
                    self._messages = MessageDecoder(dialogue.dialect.layouts)
                sink.received(Received(now, wall, item, message))
            else:
                dialogue.damaged(item, now)
                sink.dropped(Lost(now, wall, "rx", item.reason.value, item.raw))

    async def _introduce(self) -> None:
        """Find out who is there, after the opening and after every silence long enough for a reboot."""
        while True:
            await self._wants_introduction.wait()
            self._wants_introduction.clear()
            await introduce(self, probe_flightctrl=self._cfg.probe_flightctrl)

    async def _watch(self) -> None:
        """End the conversation when writing failed or the line rate is wrong."""
        assert self._broken is not None
        await self._broken

    async def _farewell(self, port: Port) -> None:
        """End an orderly exit with a release; bounded, and the port may be gone already."""
        if port.is_recording:
            return
        self._dialogue.leave(self._clock())
        with suppress(LinkError, TimeoutError):
            async with asyncio.timeout(FAREWELL_S):
                self._pump()
                while self._dialogue.is_releasing:
                    try:
                        async with asyncio.timeout(0.02):
                            chunk = await port.read()
                    except TimeoutError:
                        chunk = b""
                    self._take(chunk)
                    self._pump()
                await port.drain()

    # -- writing --------------------------------------------------------------------------------------------------

    def _pump(self) -> None:
        """Write what may be written now, settle what ended, judge and report, and set the timer for the rest."""
        now = self._clock()
        port = self._port
        if port is None:
            self._settle()
            return
        try:
            for entry in self._dialogue.poll(now):
                port.write(entry.raw)
                self._sink.sent(Sent(now, now + self._wall_offset, entry.raw, entry.message, entry.purpose))
        except LinkLostError as error:
            self._break(error)
            return
        self._settle()
        if now >= self._judge_at:
            self._judge(port, now)
        self._set_timer(min(self._dialogue.next_time(now), self._judge_at) - now)

    def _settle(self) -> None:
        """Hand answers, refusals and losses to whoever waits for them."""
        self._waiters.settle(self._dialogue)
        for entry in self._dialogue.take_discarded():
            now = self._clock()
            self._sink.dropped(Lost(now, now + self._wall_offset, "tx", "expired", entry.raw))

    async def _converse(
        self, msg: WireMessage, board: Board | None, *, patience: float | None, retries: int | None, purpose: Purpose
    ) -> WireMessage | None:
        """Ask, and wait for the outcome; a caller that is cancelled leaves nothing behind."""
        if self._port is None:
            raise LinkLostError(f"{self._cfg.port}: {self._dialogue.health.verdict.reason}")
        now = self._clock()
        waiter = self._waiters.for_answer()
        pending = self._dialogue.ask(
            msg,
            self._addressee(msg) if board is None else board,
            now,
            timeout=patience,
            retries=retries,
            purpose=purpose,
            token=waiter,
        )
        self._pump()
        try:
            return await waiter
        finally:
            self._dialogue.withdraw(pending, self._clock())

    def _addressee(self, msg: WireMessage) -> Board:
        here = self._dialogue.peers.redirected or self._dialogue.peers.direct
        return here if here in msg.spec.boards else msg.spec.boards[0]

    def _break(self, error: LinkLostError) -> None:
        if self._broken is not None and not self._broken.done():
            self._broken.set_exception(error)

    def _judge(self, port: Port, now: float) -> None:
        """Weigh the evidence, report, and act on a verdict that needs the port closed."""
        self._judge_at = max(self._judge_at + JUDGE_S, now + JUDGE_S / 2)
        health = self._dialogue.health
        health.port_backlog(port.backlog, now)
        before = health.verdict
        changed = health.judge(now)
        if changed and self._dialogue.notice(before, now):
            self._wants_introduction.set()
        if self._reporter.health_is_due(now) or changed:
            self._publish()
        if self._reporter.traffic_is_due(now):
            self._sink.traffic_counted(self._reporter.traffic(now))
        advice = self._bauds.judge(health.verdict, self._opened_at, now)
        if advice is not None:
            self._break(LinkLostError(advice))

    def _publish(self) -> None:
        now = self._clock()
        if self._reporter.state_is_news():
            self._sink.state_changed(self._reporter.state(now))
        self._sink.health_measured(self._reporter.health(now))

    def _note_loss(self, reason: str, condition: LinkCondition = LinkCondition.DOWN) -> None:
        """Say at once that the port is gone, and why."""
        self._port = None
        self._dialogue.lost(self._clock(), reason, condition)
        self._settle()
        self._waiters.port_lost(reason)
        self._publish()
        self._sink.traffic_counted(self._reporter.traffic(self._clock()))

    def _set_timer(self, delay: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(max(delay, 0.0), self._pump)

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._broken is not None and not self._broken.done():
            self._broken.cancel()
        now = self._clock()
        for item in self._decoder.flush():
            if not isinstance(item, Frame):
                self._dialogue.damaged(item, now)
                self._sink.dropped(Lost(now, now + self._wall_offset, "rx", item.reason.value, item.raw))
