"""Whether the aircraft answers our sticks: what the boards report, against what the model of the aircraft says. Pure.

With a shut gate a regulator by the target would wind up: nothing that it asks for comes back. A FlightCtrl makes the
tilt that it reports follow its sticks. So two hypotheses are weighed: what is reported is the response to our sticks,
with a factor of 0.5 to 2, or it has nothing of that response. What changes slowly is left out: wind moves the reported
tilt too. The hypotheses differ only where tilt is asked for, and most where a regulator winds up.

A broken line is another thing: an aircraft whose frames are lost obeys the last one that arrived. Where the board
confirms frames, its response to the confirmed ones is weighed beside its response to all: while either explains what
is reported, the aircraft obeys. The first frame that is confirmed after a break ends what was found during it.

Level sticks cannot be verified by tilt. Then a level aircraft counts as an answer, because a pilot's sticks tilt it.
In still air the pilot may hold it level for a while: after each wrong conclusion it must stay level for twice as long.

Where a board reports the gate itself, that decides. Source of the weighing: cumulative sums of log-likelihoods, E. S.
Page, "Continuous inspection schemes" (1954); they find a change within the time in which it shows.
"""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import AircraftModel
from mkdaemon.control.estimator.stickresponse import STEP, tilt_response
from mkdaemon.control.linear import Array

SHARES: Final = np.array([0.5, 1.0, 2.0])
"""Of the model's angle, with which the sticks may act."""
SLOW: Final = 1.5
"""What changes more slowly is left out [s]."""
INDEPENDENT: Final = 5.0
"""Independent residuals of an axis a second, half of those of both in `estimator.stickresponse`."""
ROUGHNESS: Final = math.radians(1.0)
"""What an aircraft reports beside the response to its sticks: gusts [rad]."""
MODEL_ERROR: Final = 0.25
"""And this share of that response: delays and lags are known no better."""
LEVEL: Final = math.radians(0.5)
"""Tilt of an aircraft whose sticks are level [rad]: gusts, neutral points."""
BY_HAND: Final = math.radians(3.0)
"""Tilt by which a pilot hovers [rad]."""
TOGETHER: Final = 0.2
"""What is reported within this time says the same thing [s]."""
SURE: Final = 4.0
"""Evidence that decides [nat]; 32 flights in all winds, with a wrong model and without, reached 0.05 at most."""
FORGIVEN: Final = 2.0
"""As much evidence of an answer is kept, at most [nat]: one that ends is seen at once."""
SOON: Final = 5.0
"""An answer that is missing again within this time was none [s]: a pilot held the aircraft level."""
MOST_OWED: Final = 64.0
"""Largest evidence that is asked for of an answer that came back [nat]: 4 s of an aircraft that is level."""
SPARSE: Final = 0.15
"""Attitudes farther apart are ignored [s]: their age is unknown."""
PAUSE: Final = 0.3
"""After a longer pause of stick frames the pilot has flown, and the watch restarts [s]."""
NUMBERED: Final = 128
"""Written frames whose confirmation is awaited: half of the numbers there are, 2.5 s of a stream at 50 Hz."""
CUT: Final = 0.2
"""Reports come and frames leave, but none was confirmed during this time [s]: the uplink is broken. A radio that
loses 15 % in bursts of four has a pause of 0.1 s now and then."""
REPORTS: Final = 4
"""At least this number of reports must come meanwhile: a silent downlink loses the confirmations too."""
TURNS: Final = 16
"""The slowest of this number of confirmations says how long one takes: those that come later are lost."""
GATE_FRESH: Final = 2.0
"""What a board said of the gate longer ago counts no more [s]."""
REACH: Final = 0.3
"""How late an attitude may come [s]."""


class AnswerWatch:
    """One flight's answer to its sticks.

    Attributes:
        is_missing: nothing that was sent moved the aircraft.
        arrived_at: when the newest frame was written that the board confirmed [s].
        is_cut: what is sent does not arrive, as far as confirmations show it: the last frame that arrived acts on.
    """

    def __init__(self, model: AircraftModel) -> None:
        """Start without a flight."""
        self._model = model
        self._f, self._g = tilt_response(model)
        self._sent_at = -math.inf
        self._seen = self._asked = np.zeros(2)
        self._gate: tuple[bool, float] | None = None
        self._written: OrderedDict[int, tuple[float, Array]] = OrderedDict()
        self._confirmed_at = self.arrived_at = self._reported_at = -math.inf
        self._turns: deque[float] = deque([0.0], maxlen=TURNS)
        self._lost: deque[tuple[float, float]] = deque(maxlen=TURNS)
        self._owed, self._back_at = SURE, -math.inf
        self._begin(0.0)

    def forget(self) -> None:
        """Nothing is flown any more: nothing is known of an answer."""
        self.is_missing = False
        self._evidence = np.zeros((2, len(SHARES)))  # response to all frames, to the confirmed ones
        self._slow: Array | None = None  # of what is expected and of what is reported, by axis

    def _begin(self, now: float) -> None:
        """Start a flight with the tilt that was reported last, commanded by the pilot's sticks."""
        self.forget()
        self._is_judged = False
        self._written.clear()
        self._state = np.zeros((2, 2, len(self._g)))  # all frames or confirmed ones, axis
        self._state[..., 0] = self._state[..., 3] = self._seen
        self._time = self._judged_at = self._began_at = now
        self.is_cut, self._reports = False, 0
        self._commands = tuple(deque([(-math.inf, self._seen)]) for _ in range(2))
        self._expected: deque[tuple[float, Array]] = deque([(now, self._state[..., 0].copy())])

    @property
    def evidence(self) -> float:
        """That it does not answer, against the share with which it would answer best: `SURE` at most [nat]."""
        return float(self._evidence.min())

    @property
    def expected(self) -> Array:
        """Pitch and roll (2,) of an aircraft that answers as the model says, at the newest report [rad]."""
        expected: Array = self._expected[-1][1][0]
        return expected

    @property
    def is_sure(self) -> bool:
        """Whether it is decided that the sticks act."""
        return not self.is_missing and self.evidence <= -FORGIVEN

    @property
    def is_doubted(self) -> bool:
        """Whether it may be that nothing answers any more; flights that answer come nowhere near it after 0.4 s."""
        return self._is_judged and self.evidence > -FORGIVEN / 2.0

    def model_found(self, model: AircraftModel) -> None:
        """Go on with what is known by now of this aircraft and its line: the delays, the stick filter."""
        if model.stick_filter != self._model.stick_filter:
            self._f, self._g = tilt_response(model)
        self._model = model

    def sent(self, pitch: float, roll: float, now: float) -> None:
        """Take the sticks of a frame that goes out now [stick; s]."""
        if now - self._sent_at > PAUSE:
            self._begin(now)
        self._sent_at = now
        self._asked = np.array([pitch, roll]) * self._model.rad_per_count
        self._act(0, now, self._asked)
        if self._confirmed_at == -math.inf:  # a board that confirms nothing says nothing about its frames
            self._act(1, now, self._asked)
        self._advance(now - REACH)  # no report of an earlier moment comes: a silence leaves nothing to catch up

    def frame_written(self, number: int, now: float) -> None:
        """Take that the newest sticks left now [s], under the number by which they are confirmed."""
        self._written.pop(number, None)
        self._written[number] = now, self._asked
        while len(self._written) > NUMBERED:
            self._written.popitem(last=False)

    def frame_confirmed(self, number: int, now: float) -> None:
        """Take that the board has the frame with this number; older ones are not waited for any more."""
        if number not in self._written:
            return
        while True:
            each, (written, asked) = self._written.popitem(last=False)
            if each == number:
                break
        self._act(1, written, asked)
        self.arrived_at, self._reports = written, 0
        self._turns.append(now - written)
        self._lost.clear()
        if now - self._confirmed_at > PAUSE:
            self.line_heals()
        self._confirmed_at = now
        self.is_cut = False

    def line_heals(self) -> None:
        """Take that frames arrive again: an answer that was missing meanwhile is no reason to stop."""
        if self.is_missing:
            self.forget()

    def _act(self, stream: int, sent: float, asked: Array) -> None:
        """Let sticks that were sent at a time [s] act: of all frames (0) or of confirmed ones (1)."""
        commands = self._commands[stream]
        commands.append((max(sent + self._model.uplink, commands[-1][0]), asked))

    def attitude_received(self, at: float, pitch: float, roll: float, *, says_something: bool) -> None:
        """Take what the boards reported of a moment.

        Args:
            at: when it was measured [s].
            pitch: nose down positive [rad].
            roll: right side down positive [rad].
            says_something: the aircraft is in the air, and flown in a way in which no answer means something.
        """
        self._seen = np.array([pitch, roll])
        if at - self._sent_at > PAUSE:
            return
        self._reports += 1
        self._miss_confirmations(at + self._model.attitude_age)
        silent = at - max(self._confirmed_at, self._began_at)
        self.is_cut = self._confirmed_at > -math.inf and silent > CUT and self._reports >= REPORTS
        self._advance(at)
        passed, self._judged_at = at - self._judged_at, max(self._judged_at, at)
        expected = next((value for time, value in reversed(self._expected) if time <= at), None)
        if expected is None or not says_something or not 0.0 < passed <= SPARSE:
            return
        if self.is_missing:
            self._weigh_level(passed / TOGETHER)
        else:
            self._weigh(expected, passed)

    def _miss_confirmations(self, came: float) -> None:
        """Take that a report came at a moment [s], and no confirmation since the one before it."""
        turn = max(self._turns)
        if came - self._reported_at <= SPARSE:
            since = self._reported_at - turn
            if self._lost and self._lost[-1][1] >= since:
                since = self._lost.pop()[0]
            self._lost.append((since, came - turn))
        self._reported_at = came

    def has_lost(self, written: float) -> bool:
        """Whether a frame written at a moment [s] was lost: reports came when its confirmation was due.

        Of a frame whose confirmation is not due yet, or was due in a silence of the downlink, nothing is known.
        """
        return any(since < written <= until for since, until in self._lost)

    def gate_reported(self, now: float, *, is_open: bool) -> None:
        """Take the gate as a board reports it now [s]; an opened gate restarts the watch."""
        if is_open and self.is_gate_shut(now):
            self.forget()
        self._gate = (is_open, now)

    def is_gate_shut(self, now: float) -> bool:
        """Whether a board has said lately that the gate is shut."""
        return self._gate is not None and not self._gate[0] and now - self._gate[1] <= GATE_FRESH

    def missing_words(self, now: float) -> str:
        """Known reason why the sticks do not act, at a time [s]; empty if they may."""
        if self.is_gate_shut(now):
            return "the board reports the gate shut"
        return "its tilt does not follow them" if self.is_missing else ""

    def _weigh(self, expected: Array, passed: float) -> None:
        """Add what one report says of the fast part of the response: it is in what is reported, or it is not."""
        signals = np.concatenate([expected, self._seen[None]])
        slow = signals if self._slow is None else self._slow
        self._slow = slow + (signals - slow) * (1.0 - math.exp(-passed / SLOW))
        fast = signals - self._slow
        asked, seen = fast[:2], fast[2]
        acts = SHARES[:, None] * asked[:, None, :]
        # Log-likelihood ratio of "no answer" (the report holds none of the expected motion) against "answers" (it holds
        # a share of it), summed and clipped at both ends. Source: E. Page, Biometrika 41 (1954), cumulative sums.
        variance = ROUGHNESS**2 + (MODEL_ERROR * acts) ** 2
        gained = ((acts - seen) ** 2 - seen**2) / (2.0 * variance)
        evidence = self._evidence + INDEPENDENT * passed * gained.sum(axis=2)
        self._evidence = np.minimum(np.maximum(evidence, -FORGIVEN), SURE)
        self.is_missing = self.evidence >= SURE
        self._is_judged = self._is_judged or self.is_missing or self.is_sure
        if self.is_missing:
            is_again = self._judged_at - self._back_at <= SOON
            self._owed = min(2.0 * self._owed, MOST_OWED) if is_again else SURE

    def _weigh_level(self, weight: float) -> None:
        """Add what one report says under level sticks: how likely it is for an aircraft that is level, or flown."""
        level, by_hand = (-(self._seen**2) / (2.0 * sd**2) - math.log(sd) for sd in (LEVEL, BY_HAND))
        self._evidence = np.minimum(self._evidence + weight * float((by_hand - level).sum()), SURE)
        if self.evidence <= -self._owed:
            self._back_at = self._judged_at
            self.forget()

    def _advance(self, until: float) -> None:
        while self._time + STEP <= until:
            for commands in self._commands:
                while len(commands) > 1 and commands[1][0] <= self._time + STEP / 2.0:
                    commands.popleft()
            drive = np.array([commands[0][1] for commands in self._commands])
            self._state = self._state @ self._f.T + drive[..., None] * self._g
            self._time += STEP
            self._expected.append((self._time, self._state[..., 0].copy()))
        while len(self._expected) > 1 and self._expected[0][0] < until - REACH:
            self._expected.popleft()
