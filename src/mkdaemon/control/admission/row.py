"""One row of the table of admission, what it finds, and when it is asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Self

from mkdaemon.control.admission.beginnings import Concern
from mkdaemon.control.admission.situation import Situation
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.preflight import Blocks, CheckState
from mkdaemon.telemetry.refusals import Token


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a row.

    Attributes:
        state: in one word.
        words: in words; of the refusal where it stands.
        refusal: why; None where nothing stands.
    """

    state: CheckState
    words: str
    refusal: CommandRejectedError | None = None


def passed(words: str = "") -> Verdict:
    """The check passed."""
    return Verdict(CheckState.PASSED, words)


def unknown(words: str) -> Verdict:
    """The daemon cannot decide this check."""
    return Verdict(CheckState.UNKNOWN, words)


def stands(refusal: CommandRejectedError) -> Verdict:
    """The check prevents the flight or request."""
    return Verdict(CheckState.STANDS, refusal.reason, refusal)


def when(refusal: CommandRejectedError | None) -> Verdict:
    """Result of a row that only refuses: passed without words otherwise."""
    return passed() if refusal is None else stands(refusal)


class Rule(StrEnum):
    """Rule by which a failed row refuses.

    Attributes:
        meaning: in words, for the documentation.
    """

    meaning: str

    def __new__(cls, word: str, meaning: str) -> Self:
        """Declare one."""
        member = str.__new__(cls, word)
        member._value_, member.meaning = word, meaning
        return member

    BEGINNING = (
        "refuses",
        "It refuses every beginning it concerns, in flight too. A flight in progress goes on; and hold or landing of "
        "an aircraft that is already flown by the target are the way out, and not refused.",
    )
    ALWAYS = (
        "refuses always",
        "It refuses every beginning it concerns, and every later setpoint of it: it cannot be done at all.",
    )
    ENTRY = (
        "waits, then refuses",
        "Before the flight the stream waits for it. From sticks or attitude to a manoeuvre by the target it refuses; "
        "between manoeuvres by the target it does not apply. A flight by the target that goes on when the aircraft "
        "answers its sticks again waits only for a fresh image and a certain place: wind carries a level one away.",
    )
    WAITS = ("waits", "Before the flight the stream waits for it; in flight it does not apply.")
    ADVICE = ("advises", "It is shown and refuses nothing.")


Look = Callable[[Situation, Any], Verdict]
"""Looks at the situation and at what is to begin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AdmissionRow:
    """One row.

    Attributes:
        name: shown.
        concerns: what it may refuse.
        stands: in which situation, in words.
        tokens: of its refusals.
        look: the row itself.
        rule: when it refuses.
        is_early: what it looks at is known before anything is read for the beginning.
        is_shown: it is a check before a flight, shown by `mkctl preflight`.
        is_asked_again: of a flight, too, that goes on when the aircraft answers its sticks again.
    """

    name: str
    concerns: tuple[Concern, ...]
    stands: str
    tokens: tuple[Token, ...]
    look: Look
    rule: Rule = Rule.BEGINNING
    is_early: bool = False
    is_shown: bool = False
    is_asked_again: bool = True

    @property
    def blocks(self) -> Blocks:
        """What the row prevents, as `mkctl preflight` shows it."""
        if self.rule is Rule.ADVICE:
            return Blocks.NOTHING
        return Blocks.LEASE if Concern.LEASE in self.concerns else Blocks.AUTONOMY


Check = Callable[[Situation], Verdict]
"""Looks at the situation alone."""


class Rows(list[AdmissionRow]):
    """Rows in the order in which they are declared, each at its look."""

    def row(
        self, name: str, concerns: tuple[Concern, ...], stands: str, *tokens: Token, **more: Any
    ) -> Callable[[Look], Look]:
        """Declare the row of a look; `more` are other fields of `AdmissionRow`."""

        def declare(look: Look) -> Look:
            self.append(AdmissionRow(name=name, concerns=concerns, stands=stands, tokens=tokens, look=look, **more))
            return look

        return declare

    def check(
        self, name: str, concerns: tuple[Concern, ...], stands: str, *tokens: Token, **more: Any
    ) -> Callable[[Check], Check]:
        """The same of a check before a flight, as `mkctl preflight` shows it."""

        def declare(look: Check) -> Check:
            self.row(name, concerns, stands, *tokens, is_shown=True, **more)(lambda now, beginning: look(now))
            return look

        return declare
