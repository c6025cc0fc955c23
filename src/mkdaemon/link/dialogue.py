"""The conversation with the boards: everything the link decides, without a clock, a port or a task.

Told what arrived (`received`, `damaged`) and what callers want (`ask`, `steer`, `release`, `want`), it answers `poll`
with the frames to write now and `next_time` with when to poll again.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import Final

from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link import budget, release, requests
from mkdaemon.link.health import SUSPICION_S, HealthMonitor, Verdict
from mkdaemon.link.line import ESCAPE, LineRules
from mkdaemon.link.scheduler import Entry, TransmitScheduler
from mkdaemon.link.subscriptions import KINDS, Subscriptions, kind_of
from mkdaemon.link.traffic import Purpose
from mkdaemon.protocol.dialect import Dialect, Evidence, decide
from mkdaemon.protocol.framing import Dropped, DropReason, Frame
from mkdaemon.protocol.messages.linktest import EchoRequest
from mkdaemon.protocol.messages.version import VersionRequest
from mkdaemon.protocol.wire import Board, Unknown, WireMessage
from mkdaemon.telemetry.link import LinkCondition

FORWARDED: Final = frozenset("by")
"""Letters a NaviCtrl passes on to the FlightCtrl."""
ECHO_EVERY_S: Final = 0.2
"""Default rhythm of link tests, and how old other proof may be before `auto` sends one [s]."""
PROOF_LETTERS: Final = frozenset("VQPGO")
"""Replies that tell something about the firmware."""
REBOOT_S: Final = 0.5
"""A silence longer than this may have been a reboot [s]."""
Outcome = tuple[requests.Pending, WireMessage | str | None]
"""A question, and its answer; None where it was sent and none ever comes; or why there is none."""
MOTORS_RUN: Final = 0x01
"""FCStatusFlags bit 0."""


class Dialogue:
    """One line and the boards on it."""

    def __init__(self, cfg: LinkConfig, now: float) -> None:
        self._cfg = cfg
        self.rules = LineRules(baud=cfg.baud, gap=cfg.gap_ms / 1000, setpoint_interval=1 / cfg.setpoint_hz)
        self.scheduler = TransmitScheduler(self.rules)
        self.health = HealthMonitor(window=cfg.window_s, max_loss_percent=cfg.max_loss_percent, now=now)
        self.book = requests.RequestBook()
        self.subscriptions = Subscriptions(Board.ANY, renew=cfg.renew_s)
        self.evidence = Evidence()
        self.dialect: Dialect = decide(self.evidence)
        self.direct = Board.ANY
        self.redirected: Board | None = None
        self.boards: set[Board] = set()
        self.plan: release.ReleasePlan | None = None
        self.streams_on = False
        self.is_open = False
        self.is_recording = False
        self.confirms_hidden = 0
        self._finished: list[Outcome] = []
        self._discarded: list[Entry] = []
        self.counts: dict[str, Counter[str]] = {"rx": Counter(), "tx": Counter(), "dropped": Counter()}
        self.bytes: dict[str, int] = {"rx": 0, "tx": 0}
        self._dialect_changed = True
        self._number = 0
        self._pattern = 0
        self._echo_waiting = False
        self._echo_sent = -math.inf
        self._confirm_seen = False
        self._last_command: WireMessage | None = None
        self._rx_busy: deque[tuple[float, float]] = deque(maxlen=16)
        self._motors: tuple[float, bool] = (-math.inf, True)
        self._wishes: dict[str, float] = (
            {} if isinstance(cfg.rates, str) else {key: ms / 1000 for key, ms in cfg.rates.items()}
        )

    # -- the port -------------------------------------------------------------------------------------------------

    def opened(self, now: float, *, baud: int, is_recording: bool = False) -> None:
        """A port is open. Whatever flew before may still obey its last command: a release is the first thing sent."""
        self.is_open = True
        self.is_recording = is_recording
        self.direct, self.redirected = Board.ANY, None
        self.boards.clear()
        self.streams_on = False
        self._confirm_seen = False
        self._echo_waiting = False
        self._motors = (-math.inf, True)
        self.rules = LineRules(baud=baud, gap=self.rules.gap, setpoint_interval=1 / self._cfg.setpoint_hz)
        self.scheduler.clear()
        self.scheduler.rules = self.rules
        self.subscriptions.forget()
        self.health.port_opened(now, is_recording=is_recording)
        self.release("opened", now)

    def lost(self, now: float, reason: str, *, absent: bool = False) -> bool:
        """The port is gone; returns whether that is news."""
        self.is_open = False
        self.scheduler.clear()
        self._finished.extend((pending, reason) for pending in self.book.drain())
        return self.health.port_lost(now, reason, absent=absent)

    # -- what arrives ---------------------------------------------------------------------------------------------

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
            self._rx_busy.append((now - self.rules.reply_time(size), now))
        self.scheduler.reply_seen(board, letter)
        if key in KINDS:
            self.subscriptions.seen(key, now)
        match letter:
            case "Z":
                self.health.probe_answered(message.pattern, now)  # type: ignore[attr-defined]
            case "B":
                self._confirmed(message.frame, now)  # type: ignore[attr-defined]
            case "V" if self.direct is not Board.NC or self.redirected is not None:
                self.health.probe_answered(-1, now)
            case "O":
                self._motors = (now, bool(getattr(message, "fc_flags", MOTORS_RUN) & MOTORS_RUN))
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
        self._check_reach(message, board)
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
        numbered = message.model_copy(update={"frame": self._take_number()})
        self.scheduler.submit(
            Entry(numbered.to_frame(), Purpose.SETPOINT, deadline, Board.FC, numbered, reaches_fc=True), now
        )

    def release(self, reason: str, now: float) -> None:
        """Begin to let go of the aircraft; setpoints are refused until that is done."""
        self.scheduler.drop_setpoint()
        layout = self.dialect.extern_control
        self.plan = release.ReleasePlan(
            layout=layout, last_setpoint=self._last_command, confirms=self.confirms, now=now, reason=reason
        )

    def want(self, key: str, interval: float) -> None:
        """Change one stream; 0 ends it.

        Raises:
            CommandRejectedError: no such stream, or the line cannot carry it; with the arithmetic.
        """
        streams = {**self.subscriptions.wanted, key: interval}
        if interval <= 0:
            del streams[key]
        else:
            kind_of(key, self.direct)
            budget.check(self.demand(streams), self.rules, limit=self._cfg.max_line_share)
        self.subscriptions.want(key, interval)
        self._wishes = dict(streams)

    def start_streams(self) -> list[str]:
        """Ask for the configured streams; returns those this board does not have."""
        cfg, missing = self._cfg, []
        wishes = self._wishes
        if cfg.rates == "auto" and not wishes:
            wishes = budget.best_mix(self.direct, self.rules, limit=cfg.max_line_share, demand=self.demand({}))
        for key, interval in wishes.items():
            try:
                self.subscriptions.want(key, interval)
            except CommandRejectedError:
                missing.append(key)
        self.streams_on = True
        return missing

    def demand(self, streams: dict[str, float]) -> budget.Demand:
        """What the line must carry with these streams [s]."""
        period = self.scheduler.setpoint_period
        rate = self._cfg.echo_hz
        return budget.Demand(
            streams,
            echo_hz=1 / ECHO_EVERY_S if rate == "auto" else rate,
            setpoint_hz=min(1 / period, 1 / self.rules.setpoint_interval) if period else 0.0,
            confirms=self.confirms,
        )

    def redirect(self, board: Board | None) -> None:
        """Note that a NaviCtrl passes the line through to a board; None: it speaks for itself again."""
        self.redirected = board
        self.scheduler.reserve_line(board)
        if board is None:
            self.subscriptions.forget()

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
        self._step_echo(now)
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
        if self.streams_on and self.redirected is None:
            times.append(self.subscriptions.next_time())
        times.append(self._echo_time())
        return min(times)

    # -- what is known --------------------------------------------------------------------------------------------

    @property
    def confirms(self) -> bool:
        """Whether external control frames are confirmed here: by a FlightCtrl on the wire, or if one ever came."""
        return self.direct is Board.FC or self.redirected is Board.FC or self._confirm_seen

    @property
    def is_releasing(self) -> bool:
        """Whether a release is under way."""
        return self.plan is not None and self.plan.is_running

    def motors_known_off(self, now: float) -> bool:
        """Whether fresh telemetry says that the motors stand still."""
        stamp, running = self._motors
        return now - stamp < 1.0 and not running

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
        self.subscriptions.forget()
        return now - before.since > REBOOT_S

    # -- inside ---------------------------------------------------------------------------------------------------

    def _meet(self, board: Board) -> None:
        """Learn from a sender who is at the other end of the wire."""
        if board in (Board.FC, Board.NC):
            self.boards.add(board)
        if board is self.direct or board not in (Board.FC, Board.NC) or self.redirected is not None:
            return
        if board is Board.NC or self.direct is Board.ANY:
            self._set_direct(board)

    def _set_direct(self, board: Board) -> None:
        self.direct = board
        interval = 1 / self._cfg.setpoint_hz
        if board is Board.NC:
            interval = max(interval, 0.025)
        self.rules = LineRules(self.rules.baud, board, self.rules.gap, interval)
        self.scheduler.rules = self.rules
        wanted = self.subscriptions.wanted
        self.subscriptions = Subscriptions(board, renew=self._cfg.renew_s)
        for key, interval in wanted.items():
            if board in KINDS[key].boards:
                self.subscriptions.want(key, interval)

    def _learn(self, board: Board, message: WireMessage | Unknown, now: float) -> None:
        evidence = self.evidence.with_message(board, message)
        if evidence == self.evidence:
            return
        self.evidence = evidence
        dialect = decide(evidence)
        if dialect == self.dialect:
            return
        layout, self.dialect = self.dialect.extern_control, dialect
        self._dialect_changed = True
        if dialect.extern_control not in (None, layout):
            # The release of the opening went out in the layout that is safe everywhere but not understood everywhere.
            self.release("external control layout known", now)

    def _check_reach(self, message: WireMessage, board: Board) -> None:
        behind = self.direct is Board.NC and board is Board.FC and self.redirected is not Board.FC
        if behind and message.spec.id not in FORWARDED:
            raise CommandRejectedError(
                "board_unreachable",
                f"A NaviCtrl does not pass {message.spec.name} on to the FlightCtrl.",
                "Connect to the FlightCtrl, or redirect the line first.",
            )
        if self.direct is Board.FC and board is Board.NC:
            raise CommandRejectedError(
                "board_unreachable", "The line ends at a FlightCtrl, not at a NaviCtrl.", "Connect to the NaviCtrl."
            )

    def _reaches_fc(self, message: WireMessage, board: Board) -> bool:
        if self.direct is Board.NC and self.redirected is None:
            return board is Board.FC and message.spec.id in FORWARDED
        return True

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
                reaches_fc=self._reaches_fc(message, pending.board),
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
                self._echo_waiting = False
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
            numbered = message.model_copy(update={"frame": self._take_number()})
            self.scheduler.submit(
                Entry(numbered.to_frame(), Purpose.RELEASE, now + 1.0, Board.FC, numbered, reaches_fc=True, tag=plan),
                now,
            )
        if plan.is_running:
            return
        if plan.status == "unconfirmed":
            self.scheduler.quieten(self.dialect.dead_man.refreshed_by, now + release.QUIET_S)
        self._last_command = None

    def _step_streams(self, now: float) -> None:
        if not self.streams_on or self.redirected is not None or now < self.subscriptions.next_time():
            return
        for message in self.subscriptions.due(now):
            self.scheduler.submit(
                Entry(message.to_frame(self.direct), Purpose.SUBSCRIPTION, now + 1.0, self.direct, message), now
            )
        self.health.wanted(self.direct.word, self.subscriptions.wanted, now)

    def _echo_time(self) -> float:
        """When the next link test is due [s]; infinite for never."""
        rate = self._cfg.echo_hz
        if self._echo_waiting or self.direct is Board.ANY or self.redirected is not None or rate == 0:
            return math.inf
        if self.health.is_suspicious:
            return self._echo_sent + SUSPICION_S + 0.001
        if rate == "auto":
            return max(self._echo_sent, self.health.two_way_proof) + ECHO_EVERY_S
        return self._echo_sent + 1 / rate

    def _step_echo(self, now: float) -> None:
        if now < self._echo_time():
            return
        self._echo_waiting = True
        if self.direct is Board.NC:
            self._pattern = self._pattern % 0xFFFF + 1
            message: WireMessage = EchoRequest(pattern=self._pattern)
            token = self._pattern
        else:
            message, token = VersionRequest(), -1
        slot = (self.direct, message.spec.reply or "")
        self.scheduler.submit(
            Entry(
                message.to_frame(self.direct),
                Purpose.ECHO,
                now + 0.5,
                self.direct,
                message,
                slot=slot,
                reply_within=SUSPICION_S,
                tag=token,
            ),
            now,
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
            self._echo_waiting = False
            self._echo_sent = now
            self.health.probe_sent(entry.tag, now)  # type: ignore[arg-type]  # an echo's tag is its token
        elif entry.purpose in (Purpose.SETPOINT, Purpose.RELEASE):
            number: int = message.frame  # type: ignore[attr-defined]  # every layout of external control has it
            if self.confirms:
                self.health.confirm.sent(number, now)
            if entry.purpose is Purpose.SETPOINT:
                self._last_command = message
            elif isinstance(entry.tag, release.ReleasePlan):
                entry.tag.sent(message, number, now)

    def _request_sent(self, pending: requests.Pending, now: float) -> None:
        self.book.sent(pending, now)
        policy = requests.policy_for(pending.board, pending.message)
        if policy.deaf:
            self.scheduler.deafen(pending.board, now + policy.deaf)
            self.health.pause(now + policy.deaf)
        if pending.message.spec.reply is None:
            self.book.withdraw(pending, now)
            self._finished.append((pending, None))

    def _confirmed(self, number: int, now: float) -> None:
        self._confirm_seen = True
        began = self.health.confirm.began(number)
        if began is not None:
            for older, sent in self.health.confirm.before(began):
                # One confirm variable: while the board sent a long frame, this number replaced the older one.
                if any(start < began + 0.01 and end > sent for start, end in self._rx_busy):
                    self.health.confirm.forget(older)
                    self.confirms_hidden += 1
        self.health.confirmed(number, now)
        if self.plan is not None:
            self.plan.confirmed(number, now)

    def _take_number(self) -> int:
        """Rolling and never 0, which would ask for no confirmation."""
        self._number = self._number % 255 + 1
        return self._number


_ADDRESSES: Final = {int(board): board for board in Board}


def _board_of(address: int) -> Board:
    return _ADDRESSES.get(address, Board.ANY)
