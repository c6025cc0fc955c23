"""The conversation with the boards: everything the link decides, without a clock, a port or a task.

It hears what arrived and what callers want, says with `poll` what to write now and with `next_time` when to poll again.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from mkdaemon.config.link import LinkConfig
from mkdaemon.link.session import budget
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.identity import LOOK, Identity, Standstill
from mkdaemon.link.session.knownaircraft import KnownAircraft
from mkdaemon.link.session.line import FORWARDING_GAP, LineRules
from mkdaemon.link.session.peers import AFTER_PASSAGE, VERSION_KEY, Peers
from mkdaemon.link.session.prober import Prober
from mkdaemon.link.session.questions import Pending, Questions
from mkdaemon.link.session.scheduler import QueuedTransmission, TransmitScheduler
from mkdaemon.link.session.steering import ControlEntry, Steering
from mkdaemon.link.session.streams import Streams
from mkdaemon.link.session.traffic import (
    BuildSetpoint,
    FrameNumber,
    Purpose,
    SetpointFate,
    SetpointQueued,
    SetpointRefused,
)
from mkdaemon.link.session.verdict import HeldFinding, VerdictFinding
from mkdaemon.protocol.boards import board_at
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.evidence import EVIDENCE_LETTERS
from mkdaemon.protocol.framing import Dropped, DropReason, Frame
from mkdaemon.protocol.messages.control import ControlConfirm
from mkdaemon.protocol.messages.linktest import Echo
from mkdaemon.protocol.messages.navictrl import ESCAPE
from mkdaemon.protocol.messages.version import VersionReply
from mkdaemon.protocol.wire import Board, WireMessage
from mkdaemon.telemetry.control import ControlLine, Obstacle
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.refusals import TOKENS, Token, refuse

STOOD_STILL: Final = 0.25
"""A longer standstill of this program counts in the verdict [s]."""
LONGEST_PASSAGE: Final = 6.0
"""While a NaviCtrl passes the line through, its silence is our doing; a longer passage is judged like any line [s]."""


@dataclass(slots=True)
class Counters:
    """Bytes, frames by board and command letter (`nc.O`), and losses by reason.

    Attributes:
        rx_bytes: received.
        tx_bytes: sent.
        rx: right frames received.
        tx: frames sent.
        dropped: what did not get through.
    """

    rx_bytes: int = 0
    tx_bytes: int = 0
    rx: Counter[str] = field(default_factory=Counter)
    tx: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)

    def bytes_received(self, size: int) -> None:
        """Bytes arrived, whatever they are."""
        self.rx_bytes += size

    def frame_received(self, board: Board, frame: Frame) -> None:
        """A right frame arrived."""
        self.rx[f"{board.word}.{frame.id}"] += 1

    def damaged(self, loss: Dropped) -> None:
        """Bytes were no frame."""
        self.dropped[loss.reason.value] += 1

    def sent(self, entry: QueuedTransmission) -> None:
        """A frame, or the escape sequence, went out."""
        self.tx_bytes += len(entry.raw)
        if entry.message is not None:
            self.tx[f"{entry.board.word}.{entry.message.spec.id}"] += 1

    def expired(self) -> None:
        """A frame was too old to be sent."""
        self.dropped[DropReason.EXPIRED.value] += 1


class Dialogue:
    """One line and the boards on it.

    Attributes:
        known: the aircraft, over every opening of the port.
        difference: why the aircraft at a port that came back is another one; empty while nothing says so.
    """

    def __init__(self, cfg: LinkConfig, now: float) -> None:
        self._cfg = cfg
        self.rules = LineRules(baud=cfg.baud, gap=cfg.gap_ms / 1000, setpoint_interval=1 / cfg.setpoint_hz)
        self.scheduler = TransmitScheduler(self.rules)
        self.health = HealthMonitor(window=cfg.window, max_loss_percent=cfg.max_loss_percent, now=now)
        self.prober = Prober(cfg.echo_hz, self.health)
        self.streams = Streams(cfg, self.health.share)
        self.peers = Peers()
        self.questions = Questions(self.scheduler, self.peers, self.health)
        self.steering = Steering(self.scheduler, self.peers, self.health)
        self.identity = Identity(self.peers, self.steering)
        self.known = KnownAircraft()
        self.difference = ""
        self._unproven: set[Board] = set()
        self.is_open = False
        self.is_recording = False
        self.counters = Counters()
        self._discarded: list[QueuedTransmission] = []

    # -- the port -------------------------------------------------------------------------------------------------

    def port_opened(
        self, now: float, *, baud: int, is_recording: bool = False, searching: VerdictFinding | None = None
    ) -> None:
        """A port is open. Whatever flew before may still obey its last command: a release is the first thing sent."""
        self.is_open = True
        self.is_recording = is_recording
        self.identity.port_opened()
        self.difference, self._unproven = "", set(self.known.versions)
        self.streams.restart()
        self.steering.restart()
        self.prober.restart()
        self.scheduler.clear()
        self._set_rules(LineRules(baud=baud, gap=self.rules.gap, setpoint_interval=1 / self._cfg.setpoint_hz))
        self.health.port_opened(now, is_recording=is_recording, searching=searching)
        self.steering.release("opened", now)

    def port_lost(self, now: float, reason: str, condition: LinkCondition = LinkCondition.DOWN) -> None:
        """The port is gone."""
        if self.is_open:
            self.known.was_redirected = self.peers.redirected is not None
        self.is_open = False
        self.steering.control.restart()
        self.scheduler.clear()
        self.questions.port_lost(reason)
        self.health.port_lost(now, reason, condition)

    # -- what arrives ---------------------------------------------------------------------------------------------

    def bytes_received(self, size: int, now: float) -> None:
        """Bytes arrived, whatever they are."""
        self.counters.bytes_received(size)
        self.health.bytes_received(size, now)

    def frame_received(self, frame: Frame, message: WireMessage | Unknown, now: float) -> bool:
        """A right frame arrived; returns whether the boards must be identified again."""
        size = len(frame.raw)
        board = board_at(frame.address) or Board.ANY
        self.counters.frame_received(board, frame)
        if isinstance(message, Unknown):
            self.health.frame_received(board.word, f"unknown_{frame.id}", size, now)
            if frame.id in EVIDENCE_LETTERS:
                self._note_sender(board)
                self.identity.learn(board, message, now)
            return False
        key = message.spec.key
        self.health.frame_received(board.word, key, size, now)
        self._note_sender(board)
        letter = frame.id
        if not isinstance(message, ControlConfirm):
            self.steering.control.board_was_busy(now - self.rules.reply_time(size), now)
        self.scheduler.reply_seen(board, letter)
        self.streams.frame_received(key, now)
        if key == VERSION_KEY and board is not Board.ANY:
            self.identity.version_received(board, message, now)
        self._note_content(message, now)
        pending = self.questions.received(message, board, now)
        if message.spec.tells_firmware and self.questions.proves_sender(pending):
            self.identity.learn(board, message, now)
        if not isinstance(message, VersionReply) or self.questions.proves_sender(pending):
            self._note_aircraft(board, message, now)
        return self.identity.telemetry_received(message, now)

    def _note_aircraft(self, board: Board, message: WireMessage, now: float) -> None:
        """Compare the first version reply of a board after an opening with the one before, and remember the rest.

        A FlightCtrl behind a NaviCtrl cannot be asked before the line is in use.
        """
        if isinstance(message, VersionReply) and board in self._unproven:
            self._unproven.discard(board)
            self.difference = self.known.find_difference(board, message, now) or self.difference
        if not self.difference:
            self.known.note(board, message, now)

    def _note_content(self, message: WireMessage, now: float) -> None:
        """Hand a link test's echo, a confirmation or telemetry to whom it concerns."""
        match message:
            case Echo() if not self.is_recording:
                self.health.probe_answered(message.pattern, now)
            case ControlConfirm():
                if self.steering.confirmed(FrameNumber(message.frame), now):
                    self._pace_for_board()
            case _ if message.spec.key == VERSION_KEY and self.peers.direct is not Board.NC:
                self.health.version_received(now, is_requested=self.questions.awaits_version)
            case _:
                return
        self.scheduler.distance = self.health.radio_distance

    def bytes_damaged(self, loss: Dropped, now: float) -> bool:
        """Bytes arrived that are no frame; returns whether the boards must be identified again."""
        self.counters.damaged(loss)
        if not self.peers.caused_damage(now):
            self.health.damaged(loss.reason, loss.raw, now)
        if loss.reason is not DropReason.TEXT:
            self.scheduler.resynchronise()
        if loss.reason is not DropReason.TEXT or not self.identity.is_boot_text(loss.raw, now):
            return False
        self.health.boot_text_received(loss.raw, now)
        return self.identity.board_boots(now)

    def stood_still(self, lost: Standstill, now: float) -> bool:
        """This program did not run for a while; returns whether the boards must be identified again."""
        self.health.not_looked(now - lost.stopped + LOOK, now)
        if max(lost.stopped, lost.slept) > STOOD_STILL:
            self.health.stood_still(max(lost.stopped, lost.slept), now)
        return self.identity.stood_still(lost, now)

    # -- what callers want ----------------------------------------------------------------------------------------

    def ask(
        self,
        message: WireMessage,
        board: Board,
        now: float,
        *,
        timeout: float | None = None,
        retries: int | None = None,
        purpose: Purpose = Purpose.REQUEST,
        token: object = None,
    ) -> Pending:
        """Ask a board; the answer comes back through `questions.take_finished`.

        Raises:
            CommandRejectedError: a recording plays, the board cannot be reached, or the line carries no more.
        """
        if self.is_recording:
            raise refuse(Token.RECORDING)
        self.streams.request_received(message, board, now, self.rules, self.demand)
        return self.questions.ask(message, board, now, timeout=timeout, retries=retries, purpose=purpose, token=token)

    def steer(self, build: BuildSetpoint, deadline: float, now: float) -> SetpointFate:
        """Hand in a setpoint; it replaces one that waits. Refused where nothing may be steered now."""
        line, layout = self.control_line(now), self.dialect.extern_control
        if line.obstacle is not None:
            return SetpointRefused(refuse(TOKENS[line.obstacle.value], state="down", detail=line.reason))
        assert layout is not None  # a line without one is read-only
        entry = self.steering.control.entry(partial(build, layout), Purpose.SETPOINT, deadline)
        if type(entry.message) is not layout:
            return SetpointRefused(refuse(Token.WRONG_LAYOUT, given=type(entry.message).__name__))
        self.scheduler.submit(entry, now)
        return SetpointQueued(entry.number)

    def control_line(self, now: float) -> ControlLine:
        """What the line accepts from the flight core now; the only place that decides it."""
        layout, obstacle = self.dialect.extern_control_layout, self.steering.obstacle(now)
        reason = self.health.verdict.reason if layout is not None else self.dialect.read_only_reason or ""
        if not self.is_open or self.identity.was_gap(self.health.verdict, now):
            obstacle = Obstacle.LINK_DOWN
        elif self.is_recording:
            obstacle = Obstacle.RECORDING
        elif layout is None:
            obstacle = Obstacle.READ_ONLY
        elif obstacle is None and now < self.questions.deaf_until:
            obstacle, reason = Obstacle.DEAF, self.questions.deaf_because
        return ControlLine(layout, obstacle, reason, self.rules.setpoint_interval)

    def want(self, key: str, interval: float) -> None:
        """Change one stream; 0 ends it.

        Raises:
            CommandRejectedError: no such stream, or the line cannot carry it; with the arithmetic.
        """
        self.streams.want(key, interval, self.rules, self.demand)

    def start_streams(self) -> list[str]:
        """Ask for the configured streams; returns those this board does not have."""
        return self.streams.start(self.rules, self.demand)

    def demand(self, streams: dict[str, float]) -> budget.Demand:
        """Load of the line with these streams [s]."""
        period = self.scheduler.setpoint_period
        return budget.Demand(
            streams,
            echo_hz=self.prober.highest_rate,
            setpoint_hz=min(1 / period, 1 / self.rules.setpoint_interval) if period else 0.0,
            confirms=self.steering.confirms,
        )

    def redirect(self, board: Board | None, now: float) -> None:
        """Note that a NaviCtrl passes the line through to a board; None: it speaks for itself again."""
        if board is not None:
            self.health.pause(now + LONGEST_PASSAGE)
        elif self.peers.redirected is not None:
            self.health.passage_ended(now + AFTER_PASSAGE)
        self.peers.redirect(board, now)
        self.scheduler.reserve_line(board)
        if board is None:
            self.streams.forget()
        self.steering.redirection_changed()

    def escape(self, now: float) -> None:
        """Send the sequence that ends a redirection."""
        self.scheduler.submit(QueuedTransmission(ESCAPE, Purpose.REQUEST, now + 1.0, Board.NC), now)

    # -- what is sent ---------------------------------------------------------------------------------------------

    def poll(self, now: float) -> list[QueuedTransmission]:
        """Return what to write now, in order."""
        if not self.is_open or self.is_recording:
            return []
        self.questions.step(now)
        self._drop_expired(now)
        self.steering.step(now)
        self._ask_for_streams(now)
        if now >= self._probe_time():
            self.scheduler.submit(self.prober.make(self.peers.direct, now), now)
        out: list[QueuedTransmission] = []
        while (entry := self.scheduler.take(now)) is not None:
            self._note_sent(entry, now)
            out.append(entry)
        return out

    def next_time(self, now: float) -> float:
        """When to poll again [s]."""
        if self.is_recording:
            return math.inf
        times = [
            self.scheduler.next_time(now) or math.inf,
            self.questions.book.next_time(),
            self.steering.next_time(),
            self._probe_time(),
        ]
        if self.peers.redirected is None:
            times.append(self.streams.next_time())
        return min(times)

    def take_discarded(self) -> list[QueuedTransmission]:
        """Return what was never sent since the last call."""
        discarded, self._discarded = self._discarded, []
        return discarded

    # -- what is known --------------------------------------------------------------------------------------------

    @property
    def dialect(self) -> Dialect:
        """Dialect of this aircraft."""
        return self.peers.dialect

    def condition_changed(self, before: HeldFinding, now: float) -> bool:
        """The condition was this and is another one; returns whether the boards must be identified again."""
        self.scheduler.resynchronise()
        if not (before.is_outage and self.health.verdict.condition.hears_board):
            return False
        self.streams.forget()
        return self.identity.telemetry_is_back(before, now)

    # -- inside ---------------------------------------------------------------------------------------------------

    def _note_sender(self, board: Board) -> None:
        """Learn from a sender which board is at the other end of the wire."""
        if not self.peers.note_sender(board):
            return
        self._pace_for_board()
        self.streams.use_board(board)

    def _pace_for_board(self) -> None:
        """Pace for the board at the end of the wire.

        A NaviCtrl that confirms external control takes the frames itself and does not pass them on byte by byte.
        """
        interval = 1 / self._cfg.setpoint_hz
        if self.peers.direct is Board.NC and not self.steering.navictrl_confirms:
            interval = max(interval, FORWARDING_GAP)
        self._set_rules(LineRules(self.rules.baud, self.peers.direct, self.rules.gap, interval))

    def _set_rules(self, rules: LineRules) -> None:
        self.rules = self.scheduler.rules = rules

    def _drop_expired(self, now: float) -> None:
        for entry in self.scheduler.take_expired():
            if entry.purpose is Purpose.ECHO:
                self.prober.dropped()
            if isinstance(entry.tag, Pending):
                self.questions.never_sent(entry.tag, now)
            self.counters.expired()
            self._discarded.append(entry)

    def _ask_for_streams(self, now: float) -> None:
        if self.peers.redirected is not None or now < self.streams.next_time():
            return
        for entry in self.streams.due(now):
            self.scheduler.submit(entry, now)
        self.health.wanted(self.peers.direct.word, self.streams.wanted, now)

    def _probe_time(self) -> float:
        """When the next link test is due [s]; infinite while no board could answer it."""
        nobody_answers = self.peers.direct is Board.ANY or self.peers.redirected is not None
        return math.inf if nobody_answers else self.prober.next_time()

    def _note_sent(self, entry: QueuedTransmission, now: float) -> None:
        self.counters.sent(entry)
        if isinstance(entry.tag, Pending):
            self.questions.sent(entry.tag, now)
        elif entry.purpose is Purpose.ECHO:
            self.prober.sent(entry, now)
        elif isinstance(entry, ControlEntry):
            self.steering.sent(entry, now)
