"""Rating of a state."""

from enum import StrEnum
from typing import Self


class Tone(StrEnum):
    """Rating of a state, for every display of it."""

    NOTE = "note"
    """A fact, neither good nor bad."""
    OK = "ok"
    """As it should be."""
    WARN = "warn"
    """Needs attention."""
    BAD = "bad"
    """Needs action."""
    UNKNOWN = "unknown"
    """No value shows it."""

    @property
    def is_wrong(self) -> bool:
        """Whether it needs attention or action."""
        return self in (Tone.WARN, Tone.BAD)


class ToneEnum(StrEnum):
    """A closed set whose members have their words and their tone as columns.

    Attributes:
        words: shown for it.
        tone: how good it is.
    """

    words: str
    tone: Tone

    def __new__(cls, word: str, words: str = "", tone: Tone = Tone.NOTE) -> Self:
        """Declare one; a call with a word alone returns the member, as of every enumeration."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.words, member.tone = words, tone
        return member
