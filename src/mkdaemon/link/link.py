"""The link as its users see it: one port, reopened for ever, and what may be said to the boards at its other end.

Each call hands something to the dialogue and pumps the exchange; everything happens in the task of `run` and in the
callers' own. `exchange` moves bytes through the port, `dialogue` decides about them, and `discovery`
identifies the boards.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial
from typing import Any, Final, Protocol

from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError, LinkError, LinkLostError, RequestTimeoutError
from mkdaemon.link.identification import Identification
from mkdaemon.link.ports.port import Port, open_port
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.link.session.exchange import Discovery, Exchange
from mkdaemon.link.session.guarding import LineGuard
from mkdaemon.link.session.knownflight import FlightMemory
from mkdaemon.link.session.peers import Proof
from mkdaemon.link.session.reopening import AliasMemory, backoff
from mkdaemon.link.session.streams import check_rates
from mkdaemon.link.session.traffic import BuildSetpoint, LineTap, LinkSink, Purpose, ReleaseResult, SetpointFate
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.control import ControlLine, ReleaseOutcome
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkTraffic
from mkdaemon.telemetry.refusals import Token, refuse

MOTORS_FRESH: Final = 1.0
"""Before a redirection, telemetry about the motors counts for this long [s]: less than redirections are apart."""
MotorsRunning = Callable[[float, float], bool | None]
"""Tells at a time [s] whether the motors run, from telemetry of at most an age [s]; None where there is none."""


class Opener(Protocol):
    """Opens a port; `open_port` in the daemon, another function in tests."""

    def __call__(self, url: str, *, baud: int) -> Awaitable[Port]:
        """Open; raises what `open_port` raises."""


class Link:
    """A line to a MikroKopter that can be trusted: opened, watched, and opened again.

    Attributes:
        passage: held while a NaviCtrl passes the line through to another board.
    """

    def __init__(
        self,
        cfg: LinkConfig,
        sink: LinkSink,
        *,
        opener: Opener = open_port,
        clock: Clock | None = None,
        motors_running: MotorsRunning = lambda now, within: None,
        guard: LineGuard | None = None,
        tap: LineTap | None = None,
    ) -> None:
        """Prepare; `run` does the work.

        Args:
            cfg: the port, its pace and the streams.
            sink: hears of everything that crosses the line.
            opener: opens the port.
            clock: the machine's if none is given.
            motors_running: reports whether the motors run; a line is only redirected while it is known that they
                do not.
            guard: hears of the open port and of every stick frame written.
            tap: records the line.

        Raises:
            ConfigError: the configured port or a configured stream cannot exist, or the line cannot carry the rates.
        """
        check_rates(cfg)
        self._cfg = cfg
        self._clock = clock or Clock()
        self._motors_running = motors_running
        self._opener = opener
        self._aliases = AliasMemory()
        self._dialogue = Dialogue(cfg, self._clock.now())
        self._exchange = Exchange(cfg, sink, self._dialogue, self._clock, guard, tap)
        self._identification = Identification(self._dialogue, self._exchange, self._clock, motors_running)
        self.passage = asyncio.Lock()

    async def run(self, discover: Discover) -> None:
        """Open, read, write, and open again whenever the port is lost; ends only with a recording.

        Cancelling it ends with a release.

        Args:
            discover: identifies the boards on the line; see `link.discovery`.

        Raises:
            LinkError: the port could not be opened the first time, and `wait_for_port` is off.
            ConfigError: no such port can ever be opened.
        """
        has_been_open = self._cfg.wait_for_port
        delays = backoff(self._cfg.reopen_min, self._cfg.reopen_max)
        while True:
            try:
                port = await self._open()
            except LinkError as error:
                missing = isinstance(error, LinkLostError)
                self._exchange.port_lost(str(error), LinkCondition.ABSENT if missing else LinkCondition.DOWN)
                self._identification.port_lost()
                if not has_been_open:
                    raise
                await asyncio.sleep(next(delays))
                continue
            has_been_open = True
            if await self._use(port, partial(discover, self)):
                return
            if self._identification.is_other:
                await self._identification.wait_for_change(self._cfg.port)
            delays = backoff(self._cfg.reopen_min, self._cfg.reopen_max)
            await asyncio.sleep(next(delays))

    # -- what callers use -----------------------------------------------------------------------------------------

    @property
    def dialect(self) -> Dialect:
        """Dialect of this aircraft, as far as identified."""
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
    def lacks_flightctrl(self) -> bool:
        """Whether the FlightCtrl behind the NaviCtrl at the end of the wire is still to be asked for its release."""
        port = self._exchange.port
        may_ask = self._cfg.probe_flightctrl and port is not None and not port.is_recording
        may_ask = may_ask and self._dialogue.peers.looks < self._cfg.flightctrl_looks
        return may_ask and self.direct_board is Board.NC and self.dialect.fc_release is None

    @property
    def is_discovering(self) -> bool:
        """Whether a release that steering or writing needs is not known yet and still being asked for."""
        shown = self._dialogue.peers.evidence
        return self.lacks_flightctrl or (not shown.releases and shown.foreign is None)

    @property
    def heard_age(self) -> float:
        """Time since the latest right frame [s]; infinite for never."""
        return self._dialogue.health.heard_age(self._clock.now())

    @property
    def condition(self) -> LinkCondition:
        """The verdict on the line."""
        return self._dialogue.health.verdict.condition

    @property
    def is_up(self) -> bool:
        """Whether both directions work, perhaps with losses."""
        return self.condition.is_usable

    def health(self) -> LinkHealth:
        """Everything measured about the line, now."""
        return self._exchange.reporter.health(self._clock.now())

    def traffic(self) -> LinkTraffic:
        """The counters, now."""
        return self._exchange.reporter.traffic(self._clock.now())

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
            board: the addressee; by default the board at the end of the wire, or the only one that understands it.
            timeout: wait for the first answer [s]; by default what this command takes.
            retries: further attempts; by default what repeating this command may do.
            purpose: REQUEST, or BACKGROUND if no caller waits.

        Raises:
            CommandRejectedError: the board cannot be reached, too much waits, or the message has no answer.
            RequestTimeoutError: no answer, all attempts used.
            LinkLostError: the port is not open, or was lost meanwhile.
        """
        if msg.spec.reply is None:
            raise refuse(Token.NO_REPLY, name=msg.spec.name)
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

    def control_line(self) -> ControlLine:
        """What the line accepts from the flight core now."""
        return self._dialogue.control_line(self._clock.now())

    def send_setpoint(self, build: BuildSetpoint, *, deadline: float) -> SetpointFate:
        """Hand in an external control frame; the newest wins, and none leaves after its deadline.

        Raises nothing for what the line refuses: it may fall silent between a look at `control_line` and this call.

        Args:
            build: makes the message, in the layout and with the frame number it is given.
            deadline: [s; monotonic].

        Returns:
            The frame number, which the board's confirmation repeats; or why the line takes none now (see `Obstacle`,
            and `wrong_layout`).
        """
        fate = self._dialogue.steer(build, deadline, self._clock.now())
        self._exchange.pump()
        return fate

    def release(self, reason: str) -> Awaitable[ReleaseResult]:
        """Release the aircraft: neutral sticks, then Config = 0 five times, confirmed where that is possible.

        The first frame is handed in at once. Setpoints are refused until the release is done. Without an open port it
        is what goes out first after the next opening.

        Returns:
            What to wait on for its end; never raises.
        """
        waiter = self._exchange.waiters.for_release()
        if self._exchange.port is None or self._exchange.port.is_recording:
            self._exchange.waiters.end_releases(ReleaseResult(ReleaseOutcome.NOT_SENT, 0, 0, reason))
            return waiter
        self._dialogue.steering.release(reason, self._clock.now())
        self._exchange.pump()
        return waiter

    def set_rate(self, kind: str, interval: float) -> None:
        """Change the interval of a stream [s]; 0 ends it.

        Raises:
            CommandRejectedError: no such stream, or the line cannot carry it; with the arithmetic.
        """
        self._dialogue.want(kind, interval)
        self._exchange.pump()

    @property
    def doubt(self) -> CommandRejectedError | None:
        """Reason why only questions are written to a port that came back; None while the aircraft is known."""
        return self._identification.doubt

    def accept_aircraft(self) -> None:
        """Speak to the aircraft at a port that came back, because a client says that it is the right one.

        Raises:
            CommandRejectedError: `no_other_aircraft`: nothing is in doubt.
        """
        self._identification.accept()

    @property
    def firmware(self) -> dict[Board, str]:
        """Release of each board that named it since the port was opened."""
        return dict(self._dialogue.peers.firmware)

    @property
    def proof(self) -> Proof | None:
        """Board of the latest version reply; None if the line was redirected since."""
        return self._dialogue.peers.proof

    def is_proven(self, board: Board) -> bool:
        """Whether the latest version reply, not long ago, came from this board."""
        return self._dialogue.peers.is_proven(board, self._clock.now())

    @property
    def is_releasing(self) -> bool:
        """Whether a release is under way."""
        return self._dialogue.steering.is_releasing

    def recall_flight(self, memory: FlightMemory) -> None:
        """Take what an earlier process knew of a flight, to be proven by telemetry and confirmed by a client."""
        self._dialogue.identity.flight.recall(memory)

    @property
    def flight_memory(self) -> FlightMemory | None:
        """Facts of the present flight that a restarted daemon needs; None on the ground."""
        return self._dialogue.identity.flight.memory

    def offered_memory(self) -> FlightMemory | None:
        """Remembered FlightCtrl for a client to confirm, as it cannot be identified in flight; None without one."""
        return self._dialogue.identity.flight.offer(self._clock.now())

    def confirm_memory(self) -> FlightMemory:
        """Speak to the FlightCtrl as it is remembered, because a client says that it is the same one.

        Raises:
            CommandRejectedError: `nothing_remembered`.
        """
        memory = self._dialogue.identity.confirm_memory(self._clock.now())
        self._exchange.follow_dialect()
        self._exchange.pump()
        return memory

    @property
    def released_at(self) -> float:
        """Time of the last confirmed release [s; monotonic]; minus infinity for never."""
        return self._dialogue.steering.released_at

    # -- what discovery uses --------------------------------------------------------------------------------------

    def count_look(self) -> None:
        """Count that a FlightCtrl behind a NaviCtrl was asked for its release."""
        self._dialogue.peers.looks += 1

    def start_streams(self) -> None:
        """Ask for the configured streams."""
        self._dialogue.start_streams()
        self._exchange.pump()

    def motors_running(self) -> bool | None:
        """Whether telemetry of the last second says that the motors run; None where none does."""
        return self._motors_running(self._clock.now(), MOTORS_FRESH)

    def set_redirection(self, board: Board | None) -> None:
        """A NaviCtrl passes the line through to a board from now on; None: no more."""
        self._dialogue.redirect(board, self._clock.now())
        self._exchange.pump()

    async def send_escape(self) -> None:
        """Send the sequence that ends a redirection."""
        self._dialogue.escape(self._clock.now())
        self._exchange.pump()

    @property
    def needs_discovery(self) -> asyncio.Event:
        """Set after the opening, and after every sign that other boards may be there."""
        return self._exchange.needs_discovery

    # -- inside ---------------------------------------------------------------------------------------------------

    async def _converse(
        self, msg: WireMessage, board: Board | None, *, patience: float | None, retries: int | None, purpose: Purpose
    ) -> WireMessage | None:
        """Ask, and wait for the outcome; a caller that is cancelled leaves nothing behind."""
        if self.doubt is not None:
            raise self.doubt
        if not self._exchange.is_open:
            raise LinkLostError(f"{self._cfg.port}: {self._dialogue.health.verdict.reason}")
        now = self._clock.now()
        waiter = self._exchange.waiters.for_answer()
        pending = self._dialogue.ask(
            msg,
            self._addressee(msg) if board is None else board,
            now,
            timeout=patience,
            retries=retries,
            purpose=purpose,
            token=waiter,
        )
        self._exchange.pump()
        try:
            return await waiter
        finally:
            self._dialogue.questions.withdraw(pending, self._clock.now())

    def _addressee(self, msg: WireMessage) -> Board:
        here = self._dialogue.peers.redirected or self._dialogue.peers.direct
        return here if here in msg.spec.boards else msg.spec.boards[0]

    async def _use(self, port: Port, discover: Discovery) -> bool:
        """Speak to the aircraft at an open port, and close it; returns whether it was a recording that ended."""
        try:
            arrived = await self._identification.prove(port)
            if arrived is None:
                return False
            has_ended = await self._exchange.serve(port, discover, arrived)
            self._identification.port_ended(port.name)
        except LinkLostError as error:
            self._identification.port_lost()
            self._exchange.port_lost(str(error))
            return False
        else:
            return has_ended
        finally:
            self._exchange.port = None
            await port.close()

    async def _open(self) -> Port:
        url = self._cfg.port
        # Asked before each opening: another adapter may have got the number of ours meanwhile.
        port = await self._opener(self._aliases.find(url) or url, baud=self._exchange.bauds.current)
        self._aliases.learn(url)
        return port


Discover = Callable[[Link], Coroutine[Any, Any, None]]
"""Identifies the boards on a line whenever it `needs_discovery`; runs for ever."""
