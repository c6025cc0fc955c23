"""What a replay may differ in from its recording: one table, key, field, tolerance. What is not in it must be equal.

The first rule that fits counts. Keys are without `mk/<vehicle>/`, `reply/` stands before the key of a query; fields are
paths with points, elements of a list by number; `*` fits any characters.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class Within:
    """Two numbers may differ.

    Attributes:
        absolute: by so much, in the unit of the field.
        relative: or by this share of the recorded one.
    """

    absolute: float
    relative: float = 0.0

    def admits(self, recorded: Any, replayed: Any) -> bool:
        """Whether a difference is small enough; of everything but numbers none is."""
        are_numbers = _is_number(recorded) and _is_number(replayed)
        return are_numbers and math.isclose(recorded, replayed, rel_tol=self.relative, abs_tol=self.absolute)


@dataclass(frozen=True, slots=True)
class Worded:
    """Two texts may differ where both are of one form.

    Attributes:
        form: a regular expression for the whole text.
    """

    form: str

    def admits(self, recorded: Any, replayed: Any) -> bool:
        """Whether both texts have the form."""
        texts = (recorded, replayed)
        return all(isinstance(text, str) and re.fullmatch(self.form, text) is not None for text in texts)


@dataclass(frozen=True, slots=True)
class NotCompared:
    """A field that tells of the machine and not of the aircraft."""

    def admits(self, recorded: Any, replayed: Any) -> bool:
        """True."""
        return True


Tolerance = Within | Worded | NotCompared


@dataclass(frozen=True, slots=True)
class Rule:
    """One row.

    Attributes:
        key: which keys.
        field: which fields; `*` for all of them.
        tolerance: what may differ.
        why: the reason.
    """

    key: str
    field: str
    tolerance: Tolerance
    why: str

    @property
    def leaves_out_key(self) -> bool:
        """Whether nothing at all is compared of these keys, not even their number."""
        return self.field == "*" and isinstance(self.tolerance, NotCompared)


_MACHINE: Final = NotCompared()
_SLEW: Final = 1e-3
"""Most by which the system clock is slewed between two stamps of a recording [s]: 500 ppm (adjtimex(2)) of two
seconds."""
_FREE: Final = Worded(r"[\d.]+ GB free")
_FLOAT: Final = Within(1e-6, 1e-6)
"""Sums of floating point in another order: another processor or library."""

RULES: Final[tuple[Rule, ...]] = (
    Rule("event/log", "*", _MACHINE, "tells of endpoints, files and other programs of the recorded machine"),
    Rule("event/clock", "*", _MACHINE, "the system clock of the recorded machine"),
    Rule("event/mark", "*", _MACHINE, "people set marks; they come from outside and nothing follows from them"),
    Rule("record/status", "*", _MACHINE, "of the recorder and its disk"),
    Rule("bus/counts", "*", _MACHINE, "of the bus, which a replay has not"),
    Rule("vision/*/stats", "*", _MACHINE, "rates, latencies and counts of camera threads: load of the machine"),
    Rule("vision/*/image", "*", _MACHINE, "a picture for viewing, coded by another release of a library"),
    Rule("*", "*stamp.wall", Within(_SLEW), "the system clock was read at other moments and is slewed meanwhile"),
    Rule("*", "*since.wall", Within(_SLEW), "as above, of the moment a condition began"),
    Rule("*", "*.boot", _MACHINE, "names the boot of the machine"),
    Rule("*", "*.synchronised", _MACHINE, "whether the machine's clock followed a time server"),
    Rule("reply/*", "duration", _MACHINE, "measured by the bus: with what it does itself"),
    Rule("event/progress", "id", _MACHINE, "drawn at random"),
    Rule("reply/do/lease", "reply.secret", _MACHINE, "drawn at random"),
    Rule("reply/do/lease", "reply.echo", _MACHINE, "drawn at random"),
    Rule("event/command", "fields.secret", _MACHINE, "drawn at random"),
    Rule("event/command", "fields.echo", _MACHINE, "drawn at random"),
    Rule("control/preflight", "findings.*.reason", _FREE, "the disk of the recorded machine"),
    Rule("reply/do/preflight", "reply.findings.*.reason", _FREE, "as above"),
    Rule("vision/*/pose", "latency", _MACHINE, "load of the machine"),
    Rule("vision/*/pose", "covariance.*", Within(1e-12, 1e-5), "floating point of another processor or library"),
    Rule("vision/*/pose", "*", _FLOAT, "as above"),
    Rule("vision/*/tags", "*", Within(1e-4, 1e-6), "as above, in pixels and grey levels"),
    Rule("tf", "*", _FLOAT, "as above"),
    Rule("control/estimate", "*", _FLOAT, "as above"),
    Rule("control/error", "*", _FLOAT, "as above"),
)

WINDOW: Final = 0.02
"""A recorded and a replayed value of a key are the same one where their stamps are not farther apart [s]; it is no
tolerance: the stamps of the two are compared then."""


@cache
def rule_for(key: str, field: str) -> Rule | None:
    """The rule of a field; None where it must be equal."""
    return next((rule for rule in RULES if fnmatchcase(key, rule.key) and fnmatchcase(field, rule.field)), None)


@cache
def is_left_out(key: str) -> bool:
    """Whether nothing is compared of a key."""
    return any(rule.leaves_out_key and fnmatchcase(key, rule.key) for rule in RULES)


def admits(key: str, field: str, recorded: Any, replayed: Any) -> bool:
    """Whether a field may differ so."""
    if type(recorded) is type(replayed) and recorded == replayed:
        return True
    rule = rule_for(key, field)
    return rule is not None and rule.tolerance.admits(recorded, replayed)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
