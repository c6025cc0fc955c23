"""State of the line, from all that happens on it. Pure; driven with `now`.

Evidence is kept per direction. *We hear them*: a right frame within `SILENCE_TIME`. *They hear us*: a reply or a
confirmation to something we sent. Absence counts only where something was to be expected: a stream that was asked
for, a probe that was sent. Every verdict falls within half a second of the fault, with the link test at its default
5 Hz: a probe at most 0.2 s after the fault, a second one 0.1 s later because the first stayed unanswered, the verdict
another 0.1 s later. Source: docs/safety.md, "What ends a flight".
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable
from typing import Final

from mkdaemon.link.session import verdict
from mkdaemon.link.session.evidence import STALE_PERIODS, Arrivals, OwnTime, ReceivedBytes, RoundTrips
from mkdaemon.link.session.renewal import HeardShare
from mkdaemon.link.session.verdict import HeldFinding, VerdictCause, VerdictFinding
from mkdaemon.protocol.framing import DropReason
from mkdaemon.telemetry.link import KindHealth, LinkCondition, Why

SILENCE_TIME: Final = 0.35
"""Without a right frame for this long while some are due, we do not hear the board [s]."""
PROBE_PATIENCE: Final = 0.1
"""A probe unanswered for this long is followed by another at once [s]; radios of 2010 answer within 0.13 s."""
PROBES_MISSED: Final = 2
"""Unanswered probes in a row from which the board does not receive us."""
STUCK_TIME: Final = 0.15
"""A port that has not taken our bytes for this long is stuck [s]."""
GARBAGE_BYTES: Final = 6
"""Fewer undecodable bytes than this within the silence are a glitch, not a wrong baud; `#av@w` has 6."""
GARBAGE_MEMORY: Final = 1.2
"""Once garbage was seen, it is not silence before nothing came for this long [s]."""
DAMAGE_LIMIT: Final = 0.1
"""Share of damaged among all received bytes above which the line counts as degraded."""
BOOT_TIME: Final = 6.0
"""A silence this long after boot text belongs to the boot [s]; a FlightCtrl takes 4.7 s."""
BOOT_LENGTH: Final = 700
"""More bytes than this within the silence are no boot text: a FlightCtrl prints 628 characters in all."""
HOLD: Final = 1.0
"""A degraded line is up again after this time without a fault [s], so that an intermittent fault is one verdict."""
BREAK: Final = SILENCE_TIME / 2
"""A longer gap between two frames is a silence; whether the board received anything meanwhile is unknown [s]."""
DEAF_BEFORE: Final = 1.0
"""A board that sent for this long after its last answer did not receive us before it fell silent [s]."""
HUSH: Final = 0.15
"""Telemetry, or the confirmation of a stick frame, is late after this [s]; a radio's longest round trip is 0.13 s."""
UNCONFIRMED: Final = 3
"""Stick frames not confirmed for that time from which they wait in a queue; one or two may be lost."""
DOUBT: Final = 1.0
"""Period at which it is checked whether a board receives us [s]; else a line without tests stays in doubt."""
COMES_AND_GOES: Final = 2
"""Outages within the window from which a working line stays degraded, so that they are one verdict."""
BUSY: Final = 0.1
"""Part of the window in which this program did not run, above which a verdict says so [1]."""
PROBE_TIMEOUT: Final = 0.25
"""A link test without an answer for this long is lost [s]; the longest measured wait beside a saturated line is 27 ms,
the longest radio round trip 0.13 s."""


RADIO_TRIP: Final = 0.02
"""The shortest round trip of a link test by cable is shorter than this [s]: 4 ms to a NaviCtrl, 7 ms to a FlightCtrl;
by radio it is 30 ms."""
BOARD_BUSY: Final = 0.005
"""In flight nine of ten frames leave the receive buffer of a FlightCtrl within this [s]; docs/firmware-notes,
"Losses"."""
DISTANCE_SPREADS: Final = 2.1
"""One frame of 50 catches up with the one before at this distance, as part of the spread of round trips [1]: with
delays of mean `s` above the shortest, half of exp(-distance / s) do, and the median of two is 1.5 `s` above it."""
LONGEST_DISTANCE: Final = 0.04
"""A longer distance costs more stick frames than it saves requests [s]."""


class HealthMonitor:
    """Collects evidence and judges it."""

    def __init__(self, *, window: float = 10.0, max_loss_percent: float = 5.0, now: float = 0.0) -> None:
        self._own = OwnTime()
        self.echo = RoundTrips(window=window, timeout=PROBE_TIMEOUT, own=self._own)
        self.confirm = RoundTrips(window=window, timeout=PROBE_TIMEOUT, own=self._own)
        self.share = HeardShare()
        self.backlog = 0
        self._window = window
        self._max_loss = max_loss_percent
        self._arrivals = Arrivals(self._own)
        self._bytes = ReceivedBytes(window)
        self._received_at = self._talks_since = -math.inf
        self._answered = -math.inf
        self._opened: float | None = None
        self._is_recording = False
        self._open_questions: deque[float] = deque(maxlen=8)
        self._backlog_since: float | None = None
        self._verdict = HeldFinding(VerdictFinding(LinkCondition.ABSENT, "not opened yet"), now)
        self._paused_until = self._quiet_until = self._boots_until = -math.inf
        self._boot_text = b""
        self._degraded_at = self._stopped_until = -math.inf
        self._stopped_for = 0.0
        self._outages: deque[float] = deque(maxlen=16)
        self._doubted_at: float | None = None

    # -- what happened --------------------------------------------------------------------------------------------

    def port_opened(self, now: float, *, is_recording: bool = False, searching: VerdictFinding | None = None) -> None:
        """A port is open; nothing is known about its other end.

        Args:
            now: [s; monotonic].
            is_recording: no board listens.
            searching: what is tried, if a search for the line rate reopened the port.
        """
        self._opened = now
        self._is_recording = is_recording
        self._received_at = self._answered = -math.inf
        self._open_questions.clear()
        self._doubted_at = None
        self._backlog_since = None
        self.backlog = 0
        self._bytes.clear()
        self._arrivals.clear()
        self._conclude(searching or VerdictFinding(LinkCondition.DOWN, "just opened, nothing received yet"), now)

    def port_lost(self, now: float, reason: str, condition: LinkCondition = LinkCondition.DOWN) -> None:
        """The port is gone, or could not be opened."""
        self._opened = None
        self.echo.interrupted(now)
        self.confirm.interrupted(now)
        self._conclude(VerdictFinding(condition, reason), now)

    def bytes_received(self, size: int, now: float) -> None:
        """Bytes arrived, whatever they are."""
        self._bytes.arrived(size, now)

    def frame_received(self, board: str, key: str, characters: int, now: float) -> None:
        """A right frame arrived."""
        if now - self._received_at > BREAK:
            self._talks_since = now
        self._received_at = now
        self._bytes.frame(characters, now)
        self._arrivals.received(board, key, now)

    def not_looked(self, since: float, now: float) -> None:
        """Nothing ran between two times [s]: what is missing since then waits in the kernel, or was not asked."""
        self._own.miss(since, now)

    def stood_still(self, seconds: float, now: float) -> None:
        """This program did not run for this time [s]: the boards have ended their streams."""
        self.pause(now + SILENCE_TIME)
        self._open_questions.clear()
        self.echo.interrupted(now)
        self.confirm.interrupted(now)
        self._stopped_until, self._stopped_for = now + SILENCE_TIME + HOLD, seconds

    def damaged(self, reason: DropReason, raw: bytes, now: float) -> None:
        """Bytes arrived that are no frame."""
        # The text of a garbage verdict stays: its reason must not change with every line that arrives.
        self._bytes.damaged(reason, raw, now, keep_text=self._verdict.condition is not LinkCondition.GARBAGE)

    def board_answered(self, now: float) -> None:
        """A reply or confirmation shows that the board received something from us."""
        self._answered = now
        self._open_questions.clear()

    def question_sent(self, now: float) -> None:
        """Something every board answers went out."""
        self._open_questions.append(now)

    def probe_sent(self, token: Hashable, now: float) -> None:
        """A link test went out."""
        self._open_questions.append(now)
        self.echo.sent(token, now)

    def probe_answered(self, token: Hashable, now: float) -> None:
        """A link test came back."""
        hears = self.echo.proves_hearing(token, now)
        if self.echo.answered(token, now) is not None:
            self.share.note(is_answered=True)
        if hears:
            self.board_answered(now)

    def version_received(self, now: float, *, is_requested: bool) -> None:
        """A version reply came, which repeats no token; `is_requested`: a request waits for one as well."""
        token = self.echo.asked(now)
        if token is None and not is_requested:
            token = self.echo.asked_before(now)
        if token is not None:
            self.probe_answered(token, now)

    @property
    def radio_distance(self) -> float:
        """Idle line after which a frame arrives apart from the one before, however long both take [s]; 0 by cable.

        One of two frames is late by the other's delay at most. Round trips spread as the sum of two such delays.
        """
        if self.echo.fastest < RADIO_TRIP:
            return 0.0
        return min(BOARD_BUSY + DISTANCE_SPREADS * self.echo.spread, LONGEST_DISTANCE)

    def confirmed(self, token: Hashable, now: float) -> None:
        """An external control frame was confirmed."""
        hears = self.confirm.proves_hearing(token, now)
        self.confirm.answered(token, now)
        if hears:
            self.board_answered(now)

    def wanted(self, board: str, intervals: dict[str, float], now: float) -> None:
        """These streams are asked for, at these intervals [s]; others are not."""
        self._arrivals.wanted(board, intervals, now)

    def port_backlog(self, size: int, now: float) -> None:
        """Number of bytes that wait inside the port."""
        self.backlog = size
        if not size:
            self._backlog_since = None
        elif self._backlog_since is None:
            self._backlog_since = now

    def pause(self, until: float) -> None:
        """Silence is our doing until then (redirection, a board that writes its EEPROM): expect nothing."""
        self._paused_until = max(self._paused_until, until)

    def passage_ended(self, until: float) -> None:
        """Silence was our doing, and the telemetry that it ended is back then."""
        self._paused_until = until

    def keep_quiet(self, until: float) -> None:
        """Until then hardly anything is asked, so that an old dead-man runs out: silence has that reason too."""
        self._quiet_until = until

    def boot_text_received(self, text: bytes, now: float) -> None:
        """A board printed text by itself: it boots."""
        self._boots_until, self._boot_text = now + BOOT_TIME, text

    # -- what it means --------------------------------------------------------------------------------------------

    @property
    def verdict(self) -> HeldFinding:
        """The latest verdict."""
        return self._verdict

    @property
    def awaits_answer(self) -> bool:
        """A probe or a question is unanswered: the next probe should follow after `PROBE_PATIENCE`."""
        return bool(self._open_questions)

    def heard_age(self, now: float) -> float:
        """Time since the latest right frame [s]; infinite for never."""
        return now - self._received_at

    def answer_age(self, now: float) -> float:
        """Time since the latest proof that the board hears us [s]; infinite for never."""
        return now - self._answered

    def may_stand_still(self, now: float) -> bool:
        """Whether written bytes may wait in a hidden queue, as in a serial server that reads no more.

        That is so when telemetry stops, and from the first sign that nothing of ours is heard until an answer comes.
        """
        doubted_at = self._doubted_at
        if doubted_at is not None and (self._answered > doubted_at or now - doubted_at > DOUBT):
            self._doubted_at = None
        unconfirmed = len(self.confirm.before(now - HUSH))
        if self._doubted_at is None and (self._missed(now) >= PROBES_MISSED or unconfirmed >= UNCONFIRMED):
            self._doubted_at = now
        fastest = min((kind.interval or math.inf for kind in self._arrivals.asked), default=math.inf)
        is_hushed = self._own.elapsed(self._received_at, now) > max(HUSH, STALE_PERIODS * fastest)
        return is_hushed or self._doubted_at is not None

    @property
    def two_way_proof(self) -> float:
        """Time at which both directions were last proven [s; monotonic]; minus infinity for never."""
        return min(self._received_at, self._answered)

    def judge(self, now: float) -> bool:
        """Weigh the evidence; returns whether the condition changed."""
        before = self._verdict.condition
        why = Why.LOST if before.is_usable else Why.OUTAGE
        for _ in range(self.echo.expire(now, why)):
            if before.is_usable:
                self.share.note(is_answered=False)
        self.confirm.expire(now, why)
        if self._opened is None:
            return False
        finding = self._weigh(self._opened, now)
        if finding.condition.is_usable and not before.is_usable:
            # The outage has had its verdict; what it swallowed says nothing about the line as it is now.
            self.echo.forgive(now)
            self.confirm.forgive(now)
            self._bytes.forget_damage()
            finding = self._weigh(self._opened, now)
        if before.is_usable and not finding.condition.is_usable:
            self._outages.append(now)
        return self._conclude(self._hold(finding, now), now)

    def _hold(self, finding: VerdictFinding, now: float) -> VerdictFinding:
        """A line that was degraded a moment ago stays so."""
        was_degraded = self._verdict.condition is LinkCondition.DEGRADED
        if finding.condition is LinkCondition.DEGRADED:
            self._degraded_at = now
        elif finding.condition is LinkCondition.UP and was_degraded and now - self._degraded_at < HOLD:
            return self._verdict.finding
        return finding

    def kinds(self, now: float) -> tuple[KindHealth, ...]:
        """Describe every kind of frame heard or asked for."""
        return self._arrivals.health(now, self._window)

    def damage_rates(self, now: float) -> tuple[float, float]:
        """Undecodable bytes and wrong checksums a second over the window [1/s]."""
        return self._bytes.rates(now)

    def _weigh(self, opened: float, now: float) -> VerdictFinding:
        is_stuck = self._backlog_since is not None and self._own.elapsed(self._backlog_since, now) > STUCK_TIME
        if is_stuck:
            return VerdictFinding(LinkCondition.DOWN, verdict.STUCK, VerdictCause.PORT_STUCK)
        if now < self._paused_until:
            return self._verdict.finding
        silent_for = self._own.elapsed(max(self._received_at, opened), now)
        if silent_for > SILENCE_TIME and self._expects_something(now) and not self._sends_on_time(now):
            return self._explain_silence(now)
        if self._received_at == -math.inf:
            return self._verdict.finding
        if self._missed(now) >= PROBES_MISSED:
            is_deaf = silent_for < BREAK and self._missed(now, self._talks_since) >= PROBES_MISSED
            if is_deaf or self._sends_on_time(now):
                return self._explain_deafness(now)
            return self._verdict.finding  # deaf, mute or late: a moment more will tell
        if self._answered == -math.inf and not self._is_recording:
            return self._verdict.finding  # it talks, but nothing shows that it hears us
        return self._weigh_quality(now)

    def _sends_on_time(self, now: float) -> bool:
        """A board that hears nothing but sends what it was asked for, on time, is not mute between two frames."""
        return self._verdict.condition is LinkCondition.ONE_WAY and self._arrivals.are_on_time(now)

    def _explain_deafness(self, now: float) -> VerdictFinding:
        if self.backlog:
            return self._verdict.finding  # nothing left the port: the board is not to blame
        if now < self._boots_until:
            return VerdictFinding(LinkCondition.DEGRADED, verdict.boots(self._boot_text))
        if self._bytes.damaged_since(now - SILENCE_TIME) >= GARBAGE_BYTES:
            return VerdictFinding(LinkCondition.DEGRADED, verdict.DAMAGED)
        return VerdictFinding(LinkCondition.ONE_WAY, self._beside_load(verdict.UNANSWERED, now))

    def _weigh_quality(self, now: float) -> VerdictFinding:
        if now < self._stopped_until:
            return VerdictFinding(LinkCondition.DEGRADED, verdict.stood_still(self._stopped_for))
        stale = self._arrivals.overdue(now)
        if stale and now < self._boots_until:
            return VerdictFinding(LinkCondition.DEGRADED, verdict.RESTARTING)
        if stale:
            worst = max(stale, key=lambda kind: kind.missed(now))
            only = " (only link tests are answered)" if len(stale) == len(self._arrivals.asked) else ""
            reason = f"{worst.board} {worst.key} is overdue: asked every {worst.interval:g} s{only}"
            return VerdictFinding(LinkCondition.DEGRADED, reason)
        for name, trips in (("link test", self.echo), ("control frame", self.confirm)):
            sent, lost = trips.losses(now)
            # One lost probe proves nothing; the limit counts from the second on.
            if lost >= 2 and 100 * lost > self._max_loss * sent:
                reason = f"{100 * lost / sent:.1f} % of {name}s lost in {self._window:g} s"
                return VerdictFinding(LinkCondition.DEGRADED, reason)
        bad, total = self._bytes.share(now)
        if bad > DAMAGE_LIMIT * total:
            return VerdictFinding(
                LinkCondition.DEGRADED, f"{100 * bad / total:.0f} % of the received bytes are damaged"
            )
        outages = sum(1 for at in self._outages if now - at < self._window)
        if outages >= COMES_AND_GOES:
            return VerdictFinding(LinkCondition.DEGRADED, verdict.comes_and_goes(outages, self._window))
        return VerdictFinding(LinkCondition.UP, "a recording plays" if self._is_recording else "both directions proven")

    def _explain_silence(self, now: float) -> VerdictFinding:
        # Half the silence: the end of a frame that was cut off is no garbage. Once it is, slow garbage stays it.
        is_garbage = self._verdict.condition is LinkCondition.GARBAGE
        since = now - (GARBAGE_MEMORY if is_garbage else SILENCE_TIME / 2)
        if now < self._boots_until and self._bytes.arrived_since(now - SILENCE_TIME) < BOOT_LENGTH:
            return VerdictFinding(LinkCondition.MUTE, verdict.boots(self._boot_text), VerdictCause.PLAIN_TEXT)
        if self._bytes.arrived_since(since) < GARBAGE_BYTES:
            silence = self._kind_of_silence()
            reason = verdict.QUIET if now < self._quiet_until else self._beside_load(silence, now)
            return VerdictFinding(LinkCondition.MUTE, reason)
        text = self._bytes.text_since(since)
        if text is not None:
            return VerdictFinding(LinkCondition.GARBAGE, verdict.plain_text(text), VerdictCause.PLAIN_TEXT)
        return VerdictFinding(LinkCondition.GARBAGE, verdict.NO_FRAME)

    def _kind_of_silence(self) -> str:
        if self._received_at == -math.inf:
            return verdict.NOTHING
        was_deaf = self._received_at - max(self._answered, self._opened or 0.0) > DEAF_BEFORE
        return verdict.RAN_OUT if was_deaf else verdict.STOPPED

    def _expects_something(self, now: float) -> bool:
        """Whether a frame should have come: link tests are out, or a stream that was asked for is overdue.

        One link test may be late or lost once the board has spoken; a stream slower than the silence is not missed
        before its time.
        """
        enough = 1 if self._received_at == -math.inf else PROBES_MISSED
        return self._missed(now) >= enough or bool(self._arrivals.overdue(now))

    def _missed(self, now: float, talks_since: float = -math.inf) -> int:
        """Probes unanswered for longer than usual, since the board last proved that it hears us.

        A board that says nothing at all may hear us; only time after `talks_since` shows that it does not.
        """
        waiting = (max(sent, talks_since) for sent in self._open_questions)
        return sum(1 for since in waiting if self._own.elapsed(since, now) > PROBE_PATIENCE)

    def _beside_load(self, reason: str, now: float) -> str:
        """A reason, and that this machine has no time for us, which may be another one."""
        share = self._own.share_missed(now, self._window)
        return reason if share < BUSY else f"{reason}; {verdict.busy(share)}"

    def _conclude(self, finding: VerdictFinding, now: float) -> bool:
        """Make a finding the verdict; returns whether the condition changed."""
        last_arrival = max(self._received_at, self._paused_until, now if self._opened is None else self._opened)
        before, self._verdict = self._verdict, self._verdict.followed_by(finding, now, last_arrival)
        return self._verdict.condition is not before.condition
