"""Whether the aircraft answers our sticks: what the boards report, against what the model of the aircraft says. Pure.

With a shut gate, or a line that loses every stick frame, a regulator by the target would wind up: nothing that it asks
for comes back. A FlightCtrl makes the tilt that it reports follow its sticks, so two hypotheses are weighed, with every
attitude: the sticks act, with a share of 0.5 to 2 of the model's angle, or they do not, and a pilot tilts the aircraft.

Where a board reports the gate itself, that decides. Source of the weighing: a sequential probability ratio test, A.
Wald, "Sequential Analysis" (1947), bounded on both sides, so that it finds a change either way.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from mkdaemon.control.estimator.model import TH, US, AircraftModel, W, Z
from mkdaemon.control.linear import Array

STEP: Final = 0.010
"""Grid of the response [s]."""
SHARES: Final = np.array([0.5, 1.0, 2.0])
"""Of the model's angle, with which the sticks may act."""
ROUGHNESS: Final = math.radians(0.5)
"""What an aircraft that answers reports beside the response to its sticks: gusts, neutral points [rad]."""
MODEL_ERROR: Final = 0.25
"""And this share of that response: delays and lags are known no better."""
BY_HAND: Final = math.radians(3.0)
"""Tilt by which a pilot hovers [rad]."""
TOGETHER: Final = 0.1
"""What is reported within this time says the same thing [s]."""
SURE: Final = 3.0
"""Evidence that decides, either way: odds of twenty to one; twice as much turns what has been decided."""
SPARSE: Final = 0.15
"""Attitudes farther apart say nothing [s]: nobody knows how old they are."""
PAUSE: Final = 0.3
"""Without a stick frame for longer somebody else flies, and everything begins anew [s]."""
GATE_FRESH: Final = 2.0
"""What a board said of the gate longer ago counts no more [s]."""
REACH: Final = 0.3
"""How late an attitude may come [s]."""
_LOOP: Final = [TH, Z, W, US]


class AnswerWatch:
    """One flight's answer to its sticks.

    Attributes:
        is_missing: nothing that was sent moved the aircraft.
    """

    def __init__(self, model: AircraftModel) -> None:
        """Begin with an aircraft that nobody flies."""
        f, g = model.horizontal(STEP)
        self._f, self._g, self._uplink = f[np.ix_(_LOOP, _LOOP)], g[_LOOP], model.uplink
        self._rad_per_count = model.rad_per_count
        self._sent_at = -math.inf
        self._seen = np.zeros(2)
        self._gate: tuple[bool, float] | None = None
        self._begin(0.0)

    def forget(self) -> None:
        """Nothing is flown any more: nothing is known of an answer."""
        self.is_missing = False
        self._evidence = np.zeros(len(SHARES))

    def _begin(self, now: float) -> None:
        """Begin a flight with the tilt that was reported last, which somebody else's sticks ask for."""
        self.forget()
        self._state = np.zeros((2, len(_LOOP)))
        self._state[:, 0] = self._state[:, 3] = self._seen
        self._time = self._judged_at = now
        self._commands: deque[tuple[float, Array]] = deque([(-math.inf, self._seen)])
        self._expected: deque[tuple[float, Array]] = deque([(now, self._seen)])

    @property
    def evidence(self) -> float:
        """That it does not answer, against the share with which it would answer best: -`SURE` to `SURE`."""
        return float(self._evidence.min())

    @property
    def expected(self) -> Array:
        """Pitch and roll (2,) of an aircraft that answers as the model says, at the newest report [rad]."""
        return self._expected[-1][1]

    @property
    def is_sure(self) -> bool:
        """Whether it is decided that the sticks act."""
        return self.evidence <= -SURE

    def sent(self, pitch: float, roll: float, now: float) -> None:
        """Take the sticks of a frame that goes out now [stick; s]."""
        if now - self._sent_at > PAUSE:
            self._begin(now)
        self._sent_at = now
        self._commands.append((now + self._uplink, np.array([pitch, roll]) * self._rad_per_count))

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
        self._advance(at)
        passed, self._judged_at = at - self._judged_at, max(self._judged_at, at)
        expected = next((value for time, value in reversed(self._expected) if time <= at), None)
        if expected is None or not says_something or not 0.0 < passed <= SPARSE:
            return
        self._weigh(expected, passed / TOGETHER)

    def gate_reported(self, now: float, *, is_open: bool) -> None:
        """Take what a board says now [s] of the gate; one that was opened is reason to begin anew."""
        if is_open and self.is_gate_shut(now):
            self.forget()
        self._gate = (is_open, now)

    def is_gate_shut(self, now: float) -> bool:
        """Whether a board has said lately that the gate is shut."""
        return self._gate is not None and not self._gate[0] and now - self._gate[1] <= GATE_FRESH

    def missing_words(self, now: float) -> str:
        """Why the sticks do not act, as far as it is known now [s]; empty where they may."""
        if self.is_gate_shut(now):
            return "the board reports the gate shut"
        return "its tilt does not follow them" if self.is_missing else ""

    def _weigh(self, expected: Array, weight: float) -> None:
        """Add what one report (2,) says, by share of the response."""
        acts = SHARES[:, None] * expected
        variance = ROUGHNESS**2 + (MODEL_ERROR * acts) ** 2
        answering = -((self._seen - acts) ** 2) / (2.0 * variance) - np.log(variance) / 2.0
        by_hand = -(self._seen**2) / (2.0 * BY_HAND**2) - math.log(BY_HAND)
        self._evidence += weight * (by_hand - answering).sum(axis=1)
        np.clip(self._evidence, -SURE, SURE, out=self._evidence)
        if self.evidence >= SURE:
            self.is_missing = True
        elif self.evidence <= -SURE:
            self.is_missing = False

    def _advance(self, until: float) -> None:
        commands = self._commands
        while self._time + STEP <= until:
            while len(commands) > 1 and commands[1][0] <= self._time + STEP / 2.0:
                commands.popleft()
            self._state = self._state @ self._f.T + commands[0][1][:, None] * self._g
            self._time += STEP
            self._expected.append((self._time, self._state[:, 0].copy()))
        while len(self._expected) > 1 and self._expected[0][0] < until - REACH:
            self._expected.popleft()
