"""A picture as the diagnostics of ROS, which Foxglove shows too: a level, a sentence and numbers for each part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import IntEnum
from functools import partial
from typing import Any, Final, NamedTuple

from mkdaemon.reading.known import Knowledge
from mkdaemon.reading.picture import Picture
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding
from mkdaemon.telemetry.tone import Tone


class DiagnosticLevel(IntEnum):
    """Severities of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


LEVELS: Final = {
    Tone.NOTE: DiagnosticLevel.OK,
    Tone.OK: DiagnosticLevel.OK,
    Tone.WARN: DiagnosticLevel.WARN,
    Tone.BAD: DiagnosticLevel.ERROR,
    Tone.UNKNOWN: DiagnosticLevel.STALE,
}
"""The level of a tone."""
VERDICT: Final = "verdict"
"""Name of the first diagnosis: the worst thing."""
PARTS: Final = {
    "vehicle": "health",
    "control": "control/status",
    "flight": "state/flight",
    "battery": "state/battery",
    "link": "link/health",
    "receiver": "state/pilot",
    "recording": "record/status",
}
"""Facts that are diagnosed, and the keys of their numbers; cameras beside them."""


class Diagnosis(NamedTuple):
    """One part.

    Attributes:
        name: of the part.
        level: how bad it is.
        message: why, one sentence.
        values: numbers, truths and texts behind it.
    """

    name: str
    level: DiagnosticLevel
    message: str
    values: Mapping[str, object]


class PartState(NamedTuple):
    """How one part is, without its numbers.

    Attributes:
        name: of the part.
        level: how bad it is.
        message: why, one sentence.
        key: of its numbers; empty for the verdict.
    """

    name: str
    level: DiagnosticLevel
    message: str
    key: str


def states_of(picture: Picture) -> Iterator[PartState]:
    """The verdict, then every part."""
    yield PartState(VERDICT, LEVELS[picture.tone], picture.headline, "")
    eyes = {f"eye-{camera}": f"vision/{camera}/stats" for camera in picture.cameras()}
    for word, key in (PARTS | eyes).items():
        fact = picture.fact(word)
        level = DiagnosticLevel.STALE if fact.is_stale else LEVELS[fact.tone]
        yield PartState(word if word in PARTS else fact.name, level, fact.aged, key)


def diagnoses_of(picture: Picture) -> Iterator[Diagnosis]:
    """The same with their numbers; the verdict with the other alarms."""
    others = {f"alarm.{place}": alarm.text for place, alarm in enumerate(picture.alarms[1:], 1)}
    for state in states_of(picture):
        key = state.key
        values = picture.remembered(f"numbers of {key}", partial(_numbers, key)) if key else others
        yield Diagnosis(state.name, state.level, state.message, values)


def _numbers(key: str, known: Knowledge) -> Mapping[str, object]:
    """Numbers, truths and texts of the last value of a key."""
    found = known.last(key, Stamped)
    return {} if found is None else dict(_leaves(found.value.model_dump(mode="json"), ""))


def diagnosis_of(finding: Finding) -> Diagnosis:
    """What a check before a flight found."""
    bad = DiagnosticLevel.WARN if finding.blocks is Blocks.NOTHING else DiagnosticLevel.ERROR
    level = {CheckState.PASSED: DiagnosticLevel.OK, CheckState.UNKNOWN: DiagnosticLevel.WARN, CheckState.STANDS: bad}[
        finding.state
    ]
    values = {"state": finding.state.value, "token": finding.token, "blocks": finding.blocks.value}
    return Diagnosis(finding.name, level, f"{finding.reason} {finding.fix}".strip(), values)


def _leaves(part: Mapping[str, Any], head: str) -> Iterator[tuple[str, object]]:
    """Numbers, truths and texts by their path; stamps and what is not known are left out."""
    for name, one in part.items():
        if isinstance(one, list):
            of_maps = {str(each.get("key", place)): each for place, each in enumerate(one) if isinstance(each, dict)}
            yield from _leaves(of_maps, f"{head}{name}.")
        elif isinstance(one, dict):
            if "monotonic" not in one:  # no stamp: a time is no measure of health
                yield from _leaves(one, f"{head}{name}.")
        elif one is not None:
            yield f"{head}{name}", one
