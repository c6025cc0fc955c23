"""The conversation with the boards: everything the link decides, without a clock, a port or a task.

Told what arrived (`received`, `damaged`) and what callers want (`ask`, `steer`, `release`, `want`), it answers `poll`
with the frames to write now and `next_time` with when to poll again.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Final

from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link import budget, release, requests
from mkdaemon.link.acquaintance import PROOF_LETTERS, Acquaintance
from mkdaemon.link.controlpath import ControlPath
from mkdaemon.link.health import HealthMonitor, Verdict
from mkdaemon.link.line import FORWARDING_GAP_S, LineRules
from mkdaemon.link.prober import VERSION_TOKEN, Prober
from mkdaemon.link.scheduler import Entry, TransmitScheduler
from mkdaemon.link.streams import Streams
from mkdaemon.link.traffic import Purpose
from mkdaemon.protocol.dialect import Dialect
from mkdaemon.protocol.framing import Dropped, DropReason, Frame
from mkdaemon.protocol.messages.navictrl import ESCAPE
from mkdaemon.protocol.wire import Board, Unknown, WireMessage
from mkdaemon.telemetry.link import LinkCondition

REBOOT_S: Final = 0.5
"""A silence longer than this may have been a reboot [s]."""
Outcome = tuple[requests.Pending, WireMessage | str | None]
"""A question, and its answer; None where it was sent and none ever comes; or why there is none."""


class Dialogue:
    """One line and the boards on it."""

    def __init__(self, cfg: LinkConfig, now: float) -> None:
        self._cfg = cfg
        self.rules = LineRules(baud=cfg.baud, gap=cfg.gap_ms / 1000, setpoint_interval=1 / cfg.setpoint_hz)
        self.scheduler = TransmitScheduler(self.rules)
        self.health = HealthMonitor(window=cfg.window_s, max_loss_percent=cfg.max_loss_percent, now=now)
        self.control = ControlPath(self.health)
        self.prober = Prober(cfg.echo_hz, self.health)
        self.book = requests.RequestBook()
        self.streams = Streams(cfg)
        self.peers = Acquaintance()
        self.plan: release.ReleasePlan | None = None
        self.is_open = False
        self.is_recording = False
        self._finished: list[Outcome] = []
        self._discarded: list[Entry] = []
        self.counts: dict[str, Counter[str]] = {"rx": Counter(), "tx": Counter(), "dropped": Counter()}
        self.bytes: dict[str, int] = {"rx": 0, "tx": 0}
        self._dialect_changed = True
        self._navictrl_confirms = False
        self._plan_is_settled = True

    # -- the port -------------------------------------------------------------------------------------------------

    def opened(
        self,
        now: float,
        *,
        baud: int,
        is_recording: bool = False,
        searching: tuple[LinkCondition, str] | None = None,
    ) -> None:
        """A port is open. Whatever flew before may still obey its last command: a release is the first thing sent."""
        self.is_open = True
        self.is_recording = is_recording
        self.peers.restart()
        self._navictrl_confirms = False
        self.streams.restart()
        self.control.restart()
        self.prober.restart()
        self.rules = LineRules(baud=baud, gap=self.rules.gap, setpoint_interval=1 / self._cfg.setpoint_hz)
        self.scheduler.clear()
        self.scheduler.rules = self.rules
        self.health.port_opened(now, is_recording=is_recording, searching=searching)
        self.plan = None
        self.release("opened", now)

    def lost(self, now: float, reason: str, condition: LinkCondition = LinkCondition.DOWN) -> None:
        """The port is gone."""
        self.is_open = False
        self.control.restart()
        self.scheduler.clear()
        self._finished.extend((pending, reason) for pending in self.book.drain())
        self.health.port_lost(now, reason, condition)

    # -- what arrives ---------------------------------------------------------------------------------------------

    def arrived(self, size: int, now: float) -> None:
        """Bytes arrived, whatever they are."""
        self.bytes["rx"] += size
        self.health.bytes_received(size, now)

    def received(self, frame: Frame, message: WireMessage | Unknown, now: float) -> None:
        """A right frame arrived."""
        size = len(frame.raw)
        board = _board_of(frame.address)
        self.counts["rx"][f"{board.word}.{frame.id}"] += 1
        if isinstance(message, Unknown):
            self.health.frame_received(board.word, f"unknown_{frame.id}", size, now)
            if frame.id in PROOF_LETTERS:
                self._meet(board)
                self._learn(board, message, now)
            return
        key = message.spec.key
        self.health.frame_received(board.word, key, size, now)
        self._meet(board)
        letter = frame.id
        if letter != "B":
            self.control.board_was_busy(now - self.rules.reply_time(size), now)
        self.scheduler.reply_seen(board, letter)
        self.streams.seen(key, now)
        match letter:
            case "Z" if not self.is_recording:
                self.health.probe_answered(message.pattern, now)  # type: ignore[attr-defined]
            case "B":
                number: int = message.frame  # type: ignore[attr-defined]
                self.control.confirmed(number, now)
                if self.peers.direct is Board.NC and self.peers.redirected is None and not self._navictrl_confirms:
                    self._navictrl_confirms = True
                    self._apply_rules()
                if self.plan is not None:
                    self.plan.confirmed(number, now)
            case "V" if self.health.echo.began(VERSION_TOKEN) is not None:
                self.health.probe_answered(VERSION_TOKEN, now)
            case "O":
                self.peers.note_motors(message, now)
            case _:
                pass
        pending = self.book.received(message, board, now)
        if pending is not None:
            self.health.heard_us(now)
            self._finished.append((pending, message))
        # A FlightCtrl asked for the NaviCtrl's release answers under its own address: proof of nothing.
        if letter in PROOF_LETTERS and (pending is None or pending.message.spec.layout != "which"):
            self._learn(board, message, now)

    def damaged(self, loss: Dropped, now: float) -> None:
        """Bytes arrived that are no frame."""
        self.counts["dropped"][loss.reason.value] += 1
        self.health.damaged(loss.reason, loss.raw, now)
        if loss.reason is not DropReason.TEXT:
            self.scheduler.resynchronise()

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
    ) -> requests.Pending:
        """Ask a board; the answer comes back through `take_finished`.

        Raises:
            CommandRejectedError: a recording plays, the board cannot be reached, or too much waits already.
        """
        if self.is_recording:
            raise CommandRejectedError("recording", "A recording plays: nobody listens.", "Connect an aircraft.")
        self.peers.check_reach(message, board)
        policy = requests.policy_for(board, message)
        pending = requests.Pending(
            message,
            board,
            attempts_left=1 + (policy.retries if retries is None else retries),
            timeout=policy.timeout if timeout is None else timeout,
            token=token,
        )
        self.book.open(pending)
        if not self._queue_request(pending, purpose, now):
            self.book.withdraw(pending, now)
            raise CommandRejectedError(
                "busy", f"{self.scheduler.waiting} frames wait for the line already.", "Wait for their answers."
            )
        return pending

    def withdraw(self, pending: requests.Pending, now: float) -> None:
        """The caller does not wait any more."""
        self.scheduler.withdraw(pending)
        self.book.withdraw(pending, now)

    def steer(self, message: WireMessage, deadline: float, now: float) -> None:
        """Hand in a setpoint; it replaces one that waits.

        Raises:
            CommandRejectedError: nothing may be steered now; says why.
        """
        wanted = self.dialect.extern_control
        if not self.is_open:
            raise CommandRejectedError("link_down", self.health.verdict.reason + ".", "Wait until the link is up.")
        if self.is_recording:
            raise CommandRejectedError("recording", "A recording plays: nobody listens.", "Connect an aircraft.")
        if wanted is None:
            reason = self.dialect.read_only_reason or "The FlightCtrl's release is not known."
            raise CommandRejectedError("read_only", reason, "Connect a FlightCtrl whose version is known.")
        if type(message) is not wanted:
            raise CommandRejectedError(
                "wrong_layout",
                f"This FlightCtrl takes {wanted.__name__}, not {type(message).__name__}.",
                "Build the frame from the link's dialect.",
            )
        if self.is_releasing:
            raise CommandRejectedError("releasing", "A release is under way.", "Wait for its result.")
        if self.plan is not None:
            self.plan.stop()
        self.scheduler.submit(self.control.entry(message, Purpose.SETPOINT, deadline), now)

    def release(self, reason: str, now: float) -> None:
        """Begin to let go of the aircraft; setpoints are refused until that is done."""
        self.scheduler.drop_setpoint()
        layout = self.dialect.extern_control
        confirms = self.confirms and layout is not None
        plan = self.plan
        if plan is not None and plan.is_running and plan.layout is layout and plan.confirms == confirms:
            return  # it is being done, and no command came since it began
        self._plan_is_settled = False
        self.plan = release.ReleasePlan(
            layout=layout, last_setpoint=self.control.last_command, confirms=confirms, now=now, reason=reason
        )

    def leave(self, now: float) -> None:
        """Begin an orderly exit: a release, and nothing else after it."""
        self.release("exit", now)
        self.scheduler.send_only_releases()

    def want(self, key: str, interval: float) -> None:
        """Change one stream; 0 ends it.

        Raises:
            CommandRejectedError: no such stream, or the line cannot carry it; with the arithmetic.
        """
        self.streams.want(key, interval, self.rules, self.demand)

    def start_streams(self) -> list[str]:
        """Ask for the configured streams; returns those this board does not have."""
        return self.streams.begin(self.rules, self.demand)

    def demand(self, streams: dict[str, float]) -> budget.Demand:
        """What the line must carry with these streams [s]."""
        period = self.scheduler.setpoint_period
        return budget.Demand(
            streams,
            echo_hz=self.prober.highest_rate,
            setpoint_hz=min(1 / period, 1 / self.rules.setpoint_interval) if period else 0.0,
            confirms=self.confirms,
        )

    def redirect(self, board: Board | None) -> None:
        """Note that a NaviCtrl passes the line through to a board; None: it speaks for itself again."""
        self.peers.redirected = board
        self.scheduler.reserve_line(board)
        if board is None:
            self.streams.forget()
        if self.plan is not None and not self.confirms:
            self.plan.expect_no_confirmation()

    def escape(self, now: float) -> None:
        """Send the sequence that ends a redirection."""
        self.scheduler.submit(Entry(ESCAPE, Purpose.REQUEST, now + 1.0, Board.NC), now)

    # -- what is sent ---------------------------------------------------------------------------------------------

    def poll(self, now: float) -> list[Entry]:
        """Return what to write now, in order."""
        if not self.is_open or self.is_recording:
            return []
        self._time_out(now)
        self._step_release(now)
        self._step_streams(now)
        if now >= self._probe_time():
            self.scheduler.submit(self.prober.make(self.peers.direct, now), now)
        out: list[Entry] = []
        while (entry := self.scheduler.take(now)) is not None:
            self._sent(entry, now)
            out.append(entry)
        return out

    def next_time(self, now: float) -> float:
        """When to poll again [s]."""
        if self.is_recording:
            return math.inf
        times = [self.scheduler.next_time(now) or math.inf, self.book.next_time()]
        if self.plan is not None:
            times.append(self.plan.next_time())
        if self.peers.redirected is None:
            times.append(self.streams.next_time())
        times.append(self._probe_time())
        return min(times)

    # -- what is known --------------------------------------------------------------------------------------------

    @property
    def dialect(self) -> Dialect:
        """How to speak to this aircraft."""
        return self.peers.dialect

    @property
    def confirms(self) -> bool:
        """Whether external control frames are confirmed here.

        A FlightCtrl on the wire does. A NaviCtrl 0.24 never does; whether a later one does, its first `B` tells.
        """
        fc_listens = self.peers.direct is Board.FC or self.peers.redirected is Board.FC
        return fc_listens or (self._navictrl_confirms and self.peers.redirected is None)

    @property
    def is_releasing(self) -> bool:
        """Whether a release is under way."""
        return self.plan is not None and self.plan.is_running

    def take_dialect_change(self) -> bool:
        """Whether the dialect changed since the last call."""
        changed, self._dialect_changed = self._dialect_changed, False
        return changed

    def take_finished(self) -> list[Outcome]:
        """Return questions that ended since the last call, each with its outcome."""
        finished, self._finished = self._finished, []
        return finished

    def take_discarded(self) -> list[Entry]:
        """Return what was never sent since the last call."""
        discarded, self._discarded = self._discarded, []
        return discarded

    def notice(self, before: Verdict, now: float) -> bool:
        """The condition changed from this; returns whether the boards must be met anew.

        After a silence as long as a reboot another board may be there, or the same one without its subscriptions.
        """
        self.scheduler.resynchronise()
        silent = before.condition in (LinkCondition.MUTE, LinkCondition.GARBAGE)
        hears = self.health.verdict.condition in (LinkCondition.UP, LinkCondition.DEGRADED, LinkCondition.ONE_WAY)
        if not (silent and hears):
            return False
        self.streams.forget()
        return now - before.since > REBOOT_S

    # -- inside ---------------------------------------------------------------------------------------------------

    def _meet(self, board: Board) -> None:
        """Learn from a sender who is at the other end of the wire."""
        if not self.peers.meet(board):
            return
        self._apply_rules()
        self.streams.meet(board)

    def _apply_rules(self) -> None:
        """Pace for the board at the end of the wire.

        A NaviCtrl that confirms external control takes the frames itself and does not pass them on byte by byte.
        """
        interval = 1 / self._cfg.setpoint_hz
        if self.peers.direct is Board.NC and not self._navictrl_confirms:
            interval = max(interval, FORWARDING_GAP_S)
        self.rules = LineRules(self.rules.baud, self.peers.direct, self.rules.gap, interval)
        self.scheduler.rules = self.rules

    def _learn(self, board: Board, message: WireMessage | Unknown, now: float) -> None:
        layout = self.dialect.extern_control
        if not self.peers.learn(board, message):
            return
        self._dialect_changed = True
        if self.dialect.extern_control not in (None, layout):
            # The release of the opening went out in the layout that is safe everywhere but not understood everywhere.
            self.release("external control layout known", now)

    def _queue_request(self, pending: requests.Pending, purpose: Purpose, now: float) -> bool:
        message = pending.message
        letter = message.spec.reply
        return self.scheduler.submit(
            Entry(
                message.to_frame(pending.board),
                purpose,
                deadline=now + 10.0,
                board=pending.board,
                message=message,
                reaches_fc=self.peers.reaches_fc(message, pending.board),
                slot=None if letter is None else (pending.board, letter),
                reply_within=pending.timeout,
                tag=pending,
            ),
            now,
        )

    def _time_out(self, now: float) -> None:
        for pending in self.book.due(now):
            self.scheduler.resynchronise()
            if pending.attempts_left > 0:
                pending.expires = math.inf
                pending.timeout *= 1.5
                self._queue_request(pending, Purpose.RETRY, now)
            else:
                self.book.give_up(pending, now)
                self._finished.append((pending, f"{pending.board.word} did not answer, asked {pending.sent} times"))
        for entry in self.scheduler.take_expired():
            if entry.purpose is Purpose.ECHO:
                self.prober.dropped()
            if isinstance(entry.tag, requests.Pending):
                self.book.give_up(entry.tag, now)
                self._finished.append((entry.tag, "the line was never free for it"))
            self.counts["dropped"]["expired"] += 1
            self._discarded.append(entry)

    def _step_release(self, now: float) -> None:
        plan = self.plan
        if plan is None:
            return
        message = plan.due(now)
        if message is not None:
            self.scheduler.submit(self.control.entry(message, Purpose.RELEASE, now + 1.0, tag=plan), now)
        if plan.status == "confirmed":
            self.scheduler.end_quiet()  # an earlier release that could not be confirmed may have begun it
        if plan.is_running or self._plan_is_settled:
            return
        self._plan_is_settled = True
        if plan.status == "unconfirmed":
            self.scheduler.quieten(self.dialect.dead_man.refreshed_by, now + release.QUIET_S)
        self.control.last_command = None

    def _step_streams(self, now: float) -> None:
        if self.peers.redirected is not None or now < self.streams.next_time():
            return
        for message in self.streams.due(now):
            self.scheduler.submit(
                Entry(message.to_frame(self.peers.direct), Purpose.SUBSCRIPTION, now + 1.0, self.peers.direct, message),
                now,
            )
        self.health.wanted(self.peers.direct.word, self.streams.wanted, now)

    def _probe_time(self) -> float:
        """When the next link test is due [s]; infinite while nobody could answer it."""
        return (
            math.inf if self.peers.direct is Board.ANY or self.peers.redirected is not None else self.prober.next_time()
        )

    def _sent(self, entry: Entry, now: float) -> None:
        self.bytes["tx"] += len(entry.raw)
        message = entry.message
        if message is None:
            return
        self.counts["tx"][f"{entry.board.word}.{message.spec.id}"] += 1
        if isinstance(entry.tag, requests.Pending):
            self._request_sent(entry.tag, now)
        elif entry.purpose is Purpose.ECHO:
            self.prober.sent(entry, now)
        elif entry.purpose in (Purpose.SETPOINT, Purpose.RELEASE):
            # A frame in the layout that is safe everywhere is not confirmed by a board that does not understand it.
            is_understood = type(message) is self.dialect.extern_control
            number = self.control.sent(entry, now, confirms=self.confirms and is_understood)
            if isinstance(entry.tag, release.ReleasePlan):
                entry.tag.sent(message, number, now)

    def _request_sent(self, pending: requests.Pending, now: float) -> None:
        self.book.sent(pending, now)
        if pending.message.spec.id == "v":
            self.health.question_sent(now)
        policy = requests.policy_for(pending.board, pending.message)
        if policy.deaf:
            self.scheduler.deafen(pending.board, now + policy.deaf)
            self.health.pause(now + policy.deaf)
        if pending.message.spec.reply is None:
            self.book.withdraw(pending, now)
            self._finished.append((pending, None))


_ADDRESSES: Final = {int(board): board for board in Board}


def _board_of(address: int) -> Board:
    return _ADDRESSES.get(address, Board.ANY)
