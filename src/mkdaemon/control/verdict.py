"""What a check before a flight found."""

from __future__ import annotations

from dataclasses import dataclass

from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.preflight import CheckState


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a check found.

    Attributes:
        state: in one word.
        words: in words; of the refusal where it stands.
        refusal: why; None where nothing stands.
    """

    state: CheckState
    words: str
    refusal: CommandRejectedError | None = None


def passed(words: str) -> Verdict:
    """Nothing stands in the way."""
    return Verdict(CheckState.PASSED, words)


def unknown(words: str) -> Verdict:
    """Nobody can tell from here."""
    return Verdict(CheckState.UNKNOWN, words)


def stands(refusal: CommandRejectedError) -> Verdict:
    """Something stands in the way."""
    return Verdict(CheckState.STANDS, refusal.reason, refusal)
