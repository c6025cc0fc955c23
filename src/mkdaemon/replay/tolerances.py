"""What a replay may differ in from its recording: one table of key, field, tolerance and reason.

Bytes, integers, booleans and texts are equal unless a row says otherwise. Floats have a tolerance everywhere: sines,
roots and sums of another processor, `libm` or numpy differ in the last bits. The first rule that fits counts.

Keys are without `mk/<vehicle>/`; `event/command` and `event/failsafe` have the command or the action behind a colon.
Fields are paths with points, elements of a list by number; `*` fits any characters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class Within:
    """Two floats may differ; an integer is none.

    Attributes:
        absolute: in the unit of the field.
        relative: or by this share of the larger one.
    """

    absolute: float
    relative: float = 0.0

    def admits(self, recorded: Any, replayed: Any) -> bool:
        """Whether a difference is small enough; of everything but floats none is."""
        are_floats = isinstance(recorded, float) and isinstance(replayed, float)
        return are_floats and math.isclose(recorded, replayed, rel_tol=self.relative, abs_tol=self.absolute)


@dataclass(frozen=True, slots=True)
class NotCompared:
    """What tells of the machine and not of the aircraft, or what a replay does not make again."""

    def admits(self, recorded: Any, replayed: Any) -> bool:
        """True."""
        return True


Tolerance = Within | NotCompared


@dataclass(frozen=True, slots=True)
class ToleranceRule:
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


_OUT: Final = NotCompared()
_SLEW: Final = 1e-3
"""Most by which the system clock is slewed between two stamps of a recording [s]: 500 ppm (adjtimex(2)) of two
seconds."""
_TIME: Final = Within(1e-8)
"""Times and differences of times [s]: they are recorded in nanoseconds, and a float of a year is good to 4 ns. No sine
or root is in them."""
_FLOAT: Final = Within(1e-9, 1e-9)
"""Every other float. Another `libm` was seen to differ by 1.1e-16 in a quaternion; a chain of some ten operations and a
difference of two near values take the rest."""
_ESTIMATE: Final = Within(1e-7, 1e-7)
"""What the estimator makes of recorded poses: some hundred steps of a filter."""
_EYES: Final = Within(5e-4, 1e-3)
"""What follows from an image [m, rad, px]. A fit stops where its next step is a small share of the deviation that it
claims, and sums in the order of the processor's vector unit, so another processor can stop one step sooner. Seen
between two processors, of poses that claim 13 mm and 5 mrad: .2 mm, .05 mrad."""

RULES: Final[tuple[ToleranceRule, ...]] = (
    ToleranceRule(
        "link/*",
        "*",
        _OUT,
        "of the line, at its own times; the flight core gets the recorded verdicts",
    ),
    ToleranceRule("health", "*", _OUT, "follows from the line's verdict"),
    ToleranceRule("event/command:do/*", "*", _OUT, "requests are answered by tasks that wait for the line"),
    ToleranceRule("event/command:cmd/*", "*", _OUT, "as above"),
    ToleranceRule("event/progress", "*", _OUT, "procedures wait for the line"),
    ToleranceRule("event/mission", "*", _OUT, "as above"),
    ToleranceRule("event/failsafe:guard *", "*", _OUT, "of the guard's process"),
    ToleranceRule("event/failsafe:late release", "*", _OUT, "a task that waits for the line"),
    ToleranceRule("event/log", "*", _OUT, "tells of endpoints, files and other programs of the recorded machine"),
    ToleranceRule("event/clock", "*", _OUT, "the system clock of the recorded machine"),
    ToleranceRule("event/mark", "*", _OUT, "people set marks; they come from outside and nothing follows from them"),
    ToleranceRule("record/status", "*", _OUT, "of the recorder and its disk"),
    ToleranceRule("bus/counts", "*", _OUT, "of the bus, which a replay has not"),
    ToleranceRule("vision/*/stats", "*", _OUT, "rates, latencies and counts of camera threads: load of the machine"),
    ToleranceRule("core/EyeStats", "event.stats.trusted_for", _OUT, "recordings before sources of poses lack it"),
    ToleranceRule("vision/*/setup", "*", _OUT, "from the files of the recorded machine"),
    ToleranceRule("control/fence", "*", _OUT, "from the configuration, by a timer"),
    ToleranceRule("vision/*/image", "*", _OUT, "a picture for viewing, coded by another release of a library"),
    ToleranceRule(
        "*", "*stamp.wall", Within(_SLEW), "the system clock was read at other moments and is slewed meanwhile"
    ),
    ToleranceRule("*", "*since.wall", Within(_SLEW), "as above, of the moment a condition began"),
    ToleranceRule("*", "*.boot", _OUT, "names the boot of the machine"),
    ToleranceRule("*", "*.synchronised", _OUT, "whether the machine's clock followed a time server"),
    ToleranceRule("vision/*/pose", "latency", _OUT, "load of the machine"),
    ToleranceRule("*", "*stamp.monotonic", _TIME, "nanoseconds, as a float"),
    ToleranceRule("*", "*since.monotonic", _TIME, "as above"),
    ToleranceRule("vision/*/pose", "covariance.*", Within(1e-5, 0.02), "as below; seen: .7 % of a value"),
    ToleranceRule("vision/*", "*", _EYES, "follows from an image: another processor or library"),
    ToleranceRule("tf", "*", _EYES, "as above"),
    ToleranceRule("control/estimate", "*", _ESTIMATE, "sums of a filter, in another order"),
    ToleranceRule("control/error", "*", _ESTIMATE, "as above"),
    ToleranceRule("control/path", "*", _ESTIMATE, "as above: its clock waits for the aircraft"),
    ToleranceRule("*", "*", _FLOAT, "sines, roots and sums of another processor or library"),
)

WINDOW: Final = 0.02
"""A recorded and a replayed value of a key are the same one where their stamps are not farther apart [s]; it is no
tolerance: the stamps of the two are compared then."""


@cache
def rule_for(key: str, field: str) -> ToleranceRule:
    """The rule of a field."""
    return next(rule for rule in RULES if fnmatchcase(key, rule.key) and fnmatchcase(field, rule.field))


@cache
def is_left_out(key: str) -> bool:
    """Whether nothing is compared of a key."""
    return any(rule.leaves_out_key and fnmatchcase(key, rule.key) for rule in RULES)


def admits(key: str, field: str, recorded: Any, replayed: Any) -> bool:
    """Whether a field may differ so."""
    if type(recorded) is type(replayed) and recorded == replayed:
        return True
    return rule_for(key, field).tolerance.admits(recorded, replayed)
