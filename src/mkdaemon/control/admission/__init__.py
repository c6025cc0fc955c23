"""One admission: what may begin, in which situation not, why, and what to do about it.

`refusal(beginning, situation)` is asked at every beginning and at every change of manoeuvre.
"""

from mkdaemon.control.admission.beginnings import (
    BY_HAND,
    BY_TARGET,
    MANOEUVRES,
    Beginning,
    BoardRequest,
    Concern,
    NaviGoto,
    NewManoeuvre,
    Procedure,
    StartRoute,
    TakeLease,
    Upload,
)
from mkdaemon.control.admission.row import Row, Rule
from mkdaemon.control.admission.rows import ROWS, findings, is_ready, refusal, refusals, waits_for
from mkdaemon.control.admission.situation import NO_WORK, Entry, OwedSet, Situation, Work

__all__ = [
    "BY_HAND",
    "BY_TARGET",
    "MANOEUVRES",
    "NO_WORK",
    "ROWS",
    "Beginning",
    "BoardRequest",
    "Concern",
    "Entry",
    "NaviGoto",
    "NewManoeuvre",
    "OwedSet",
    "Procedure",
    "Row",
    "Rule",
    "Situation",
    "StartRoute",
    "TakeLease",
    "Upload",
    "Work",
    "findings",
    "is_ready",
    "refusal",
    "refusals",
    "waits_for",
]
