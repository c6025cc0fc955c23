"""What came out, beside what was recorded: key by key, value by value, field by field."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import msgpack

from mkdaemon.record.entry import Entry, EntryKind
from mkdaemon.record.events import TICK
from mkdaemon.replay.recorded import Recorded
from mkdaemon.replay.tolerances import WINDOW, admits, is_left_out

_ABSENT: Final = "(absent)"
_SPLIT_BY: Final = {"event/command": "key", "event/failsafe": "action"}
"""Keys under which more than one part of the daemon publishes, and the field that tells them apart."""
CUT: Final = 0.05
"""Time at the end of a recording in which a value may be missing or new [s]: what came out of the last entries may not
have been recorded any more."""


@dataclass(frozen=True, slots=True)
class ReplayOutput:
    """Something that came out of the replay.

    Attributes:
        kind: a value that is published, or an event of the flight core and its answer.
        suffix: key without `mk/<vehicle>/`.
        payload: msgpack.
        encoding: names its schema.
        at: when [s].
    """

    kind: EntryKind
    suffix: str
    payload: bytes
    encoding: str
    at: float


@dataclass(frozen=True, slots=True)
class ReplayDifference:
    """Two values that should be one.

    Attributes:
        at: since the recording began [s].
        field: which; empty where a whole value is missing or new.
        recorded: as it was.
        replayed: as it is today.
    """

    at: float
    field: str
    recorded: Any
    replayed: Any


@dataclass(slots=True)
class KeyReport:
    """How one key compares.

    Attributes:
        key: without `mk/<vehicle>/`; where several publish under it, with what tells them apart.
        recorded: values recorded.
        replayed: values that came out.
        differing: pairs that differ.
        missing: recorded, and did not come out.
        new: came out, and were not recorded.
        fields: how often each field differs.
        first: the first difference.
    """

    key: str
    recorded: int = 0
    replayed: int = 0
    differing: int = 0
    missing: int = 0
    new: int = 0
    fields: dict[str, int] = field(default_factory=dict)
    first: ReplayDifference | None = None

    @property
    def differences(self) -> int:
        """All of them."""
        return self.differing + self.missing + self.new

    def note(self, difference: ReplayDifference) -> None:
        """Keep the first one."""
        if self.first is None:
            self.first = difference


@dataclass(frozen=True, slots=True)
class Comparison:
    """The whole result.

    Attributes:
        keys: every compared key, by name.
        left_out: values of keys that are not compared, by key.
    """

    keys: Mapping[str, KeyReport]
    left_out: Mapping[str, int]

    @property
    def differences(self) -> int:
        """All of them."""
        return sum(key.differences for key in self.keys.values())

    @property
    def compared(self) -> int:
        """Recorded values that were compared."""
        return sum(key.recorded for key in self.keys.values())


@dataclass(frozen=True, slots=True)
class _Value:
    """A value, and the time by which it is found again: that of its stamp.

    A recorded value was taken when it had been coded, which may be much later than it was stamped.
    """

    at: float
    mark: float
    encoding: str
    payload: bytes


def compare(
    recorded: Recorded, outputs: Sequence[ReplayOutput], *, without: frozenset[str] = frozenset()
) -> Comparison:
    """Compare what came out with what was recorded.

    Args:
        recorded: the recording.
        outputs: of the replay.
        without: keys beginning so are not compared, for example `vision/` where images are missing.
    """
    began = recorded.start
    until = recorded.end - CUT
    entries = (*recorded.of(EntryKind.SAMPLE), *recorded.of(EntryKind.EVENT))
    before = _by_key((entry.received, entry) for entry in entries)
    after = _by_key((output.at, output) for output in outputs)
    keys: dict[str, KeyReport] = {}
    left_out: dict[str, int] = {}
    for key in sorted(before.keys() | after.keys()):
        if is_left_out(key) or key.startswith(tuple(without)):
            left_out[key] = len(before.get(key, ()))
        else:
            keys[key] = _compare_key(key, before.get(key, []), after.get(key, []), began, until)
    return Comparison(keys, left_out)


def _by_key(values: Iterable[tuple[float, Entry | ReplayOutput]]) -> dict[str, list[_Value]]:
    found: dict[str, list[_Value]] = {}
    for at, value in values:
        if value.suffix == TICK:
            continue
        fields = _fields(value.payload) if value.kind is EntryKind.SAMPLE else None
        name, mark = value.suffix, at
        if isinstance(fields, dict):
            stamp = fields.get("stamp")
            mark = float(stamp["monotonic"]) if isinstance(stamp, dict) and "monotonic" in stamp else at
            name = f"{name}:{fields.get(_SPLIT_BY[name])}" if name in _SPLIT_BY else name
        found.setdefault(name, []).append(_Value(at, mark, value.encoding, value.payload))
    return {name: sorted(found[name], key=lambda value: value.mark) for name in found}


def _compare_key(key: str, before: Sequence[_Value], after: Sequence[_Value], began: float, until: float) -> KeyReport:
    """Pair values that are marked alike, in order, and compare each pair; from `until` on a pair may be incomplete."""
    report = KeyReport(key, len(before), len(after))
    i = j = 0
    while i < len(before) or j < len(after):
        lead = _lead(before, i, after, j)
        if abs(lead) <= WINDOW:
            _compare_pair(report, before[i], after[j], began)
            i, j = i + 1, j + 1
        elif lead < 0:
            if before[i].at < until:
                report.missing += 1
                report.note(ReplayDifference(before[i].at - began, "", _fields(before[i].payload), _ABSENT))
            i += 1
        else:
            if after[j].at < until:
                report.new += 1
                report.note(ReplayDifference(after[j].at - began, "", _ABSENT, _fields(after[j].payload)))
            j += 1
    return report


def _lead(before: Sequence[_Value], i: int, after: Sequence[_Value], j: int) -> float:
    """How much later the next recorded value is marked than the next one that came out; infinite at an end."""
    if i >= len(before):
        return float("inf")
    return float("-inf") if j >= len(after) else before[i].mark - after[j].mark


def _compare_pair(report: KeyReport, before: _Value, after: _Value, began: float) -> None:
    if before.payload == after.payload and before.encoding == after.encoding:
        return
    found = list(_differences(report.key, "", _fields(before.payload), _fields(after.payload)))
    if before.encoding != after.encoding:
        found.append(("(encoding)", before.encoding, after.encoding))
    if not found:
        return
    report.differing += 1
    for path, recorded, replayed in found:
        report.fields[path] = report.fields.get(path, 0) + 1
        report.note(ReplayDifference(before.at - began, path, recorded, replayed))


def _differences(key: str, path: str, before: Any, after: Any) -> Iterator[tuple[str, Any, Any]]:
    """Every field that differs by more than it may."""
    if isinstance(before, dict) and isinstance(after, dict):
        for name in before.keys() | after.keys():
            inner = f"{path}.{name}" if path else str(name)
            yield from _differences(key, inner, before.get(name, _ABSENT), after.get(name, _ABSENT))
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for number, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from _differences(key, f"{path}.{number}", one, other)
    elif not admits(key, path, before, after):
        yield path, before, after


def _fields(payload: bytes) -> Any:
    try:
        return msgpack.unpackb(payload, strict_map_key=False)
    except (ValueError, msgpack.exceptions.UnpackException):
        return payload
