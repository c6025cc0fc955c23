"""A flight out of a recording: numbers over time, what happened, last words, and where its images are.

What is taken of which key is one table. Nothing here trusts the file: a part that is not what it should be is left out.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import degrees
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from mkdaemon.reading import EventLine, Picture, Reading
from mkdaemon.reading.facts import DEAD_RECKONING
from mkdaemon.reading.known import EACH, EVENTS
from mkdaemon.record.entry import Entry, EntryKind, unpacked
from mkdaemon.record.summary import Summary, Taker
from mkdaemon.stamp import NANOSECONDS
from mkdaemon.telemetry.control import Phase
from mkdaemon.view.report.happenings import MOST, Trouble, happening_of, lost_line, take_causes
from mkdaemon.view.report.said import number_of, numbers_of, part_of, text_of, value_of
from mkdaemon.view.report.sights import Sights, Take, taken_by
from mkdaemon.view.report.timeseries import Array, TimeSeries


class Column(NamedTuple):
    """Numbers of a key that are kept over time.

    Attributes:
        path: of the field.
        names: of the series: one of a number, three of a vector.
        factor: by which they are multiplied.
    """

    path: str
    names: tuple[str, ...]
    factor: float = 1.0


def _vector(path: str, name: str) -> Column:
    return Column(path, tuple(f"{name}.{axis}" for axis in "xyz"))


def _numbers(before: str, **paths: str) -> tuple[Column, ...]:
    """Numbers by the last word of the name of their series."""
    return tuple(Column(path, (f"{before}.{name}",)) for name, path in paths.items())


_DEGREES: Final = degrees(1.0)
_PERCENT: Final = 100.0
COLUMNS: Final[Mapping[str, tuple[Column, ...]]] = {
    "control/estimate": (_vector("position", "estimate"), *_numbers("estimate", image_age="image_age")),
    "control/error": (_vector("goal", "goal"), _vector("error_pad", "error")),
    "control/output": tuple(Column(name, (f"stick.{name}",)) for name in ("pitch", "roll", "yaw", "throttle")),
    "state/attitude": tuple(Column(name, (f"attitude.{name}",), _DEGREES) for name in ("roll", "pitch")),
    "state/altitude": (Column("above_start", ("barometer",)),),
    "state/position": (_vector("position_enu", "ground"),),
    "state/battery": tuple(Column(name, (f"battery.{name}",)) for name in ("voltage", "current", "used_mah")),
    "state/pilot": _numbers("pilot", throttle="throttle"),
    "link/health": (
        *_numbers("link", echo_p50="echo.p50_ms", echo_p95="echo.p95_ms", echo_loss="echo.loss_percent"),
        *_numbers("link", confirm_p95="confirm.p95_ms", confirm_loss="confirm.loss_percent"),
    ),
    "vision/*/stats": (
        Column("posed", ("eyes.posed",), _PERCENT),
        *_numbers("eyes", latency_p50="latency_p50_ms", latency_p99="latency_p99_ms"),
    ),
    "vision/*/pose": (_vector("position_target", "pose"),),
    "sim/truth": (_vector("position_enu", "truth"),),
}
"""What is kept of each key; `*` is a camera, whose name is put before that of the series: `down eyes.posed`."""
LAST: Final = frozenset({*EACH, "link/traffic"})
"""Keys of whose values the last one is wanted."""
IN_AIR: Final = frozenset(phase.value for phase in Phase if phase.is_in_flight)
"""Phases in which the machine steers."""
STATUS: Final = "control/status"
_POSE: Final = " pose.x"
NEAR: Final = 10.0
"""A stamp that is farther from the time at which the recorder took the value is not believed [s]."""


@dataclass(frozen=True, slots=True)
class FlownState:
    """The holder of the lease and the manoeuvre, from one moment on; equal where they are, whatever the moment.

    Attributes:
        at: [s].
        phase: of authority.
        manoeuvre: that is flown; empty for none.
        stage: of it; empty for none.
        is_done: what it asks for is reached.
        reason: why the phase is what it is.
        outcome: of the last manoeuvre; empty for none.
    """

    at: float = field(compare=False)
    phase: str
    manoeuvre: str
    stage: str
    is_done: bool
    reason: str
    outcome: str

    @property
    def is_flown(self) -> bool:
        """Whether the machine steers."""
        return self.phase in IN_AIR


@dataclass(frozen=True, slots=True)
class ImagePlace:
    """Where an image is in the recording.

    Attributes:
        at: when it was exposed [s].
        kind: of its entry.
        key: of its entry.
        sequence: of its entry.
    """

    at: float
    kind: EntryKind
    key: str
    sequence: int


@dataclass
class RecordedFlight:
    """One vehicle in a recording.

    Attributes:
        vehicle: its name.
        entries: how many are of it.
        series: numbers over time, by name.
        states: changes of the holder and the manoeuvre.
        troubles: what kept it from going on, in order.
        conditions: changes of the link's condition: time [s], word.
        happenings: in order.
        left_out: happenings beyond those that are kept.
        images: where they are.
        last: last values with their times [s], by key.
        reading: the same, as far as they are what their keys carry.
        parameters: the FlightCtrl's active parameter set, as it was read last; empty where it was not.
        model: of the aircraft that was flown on; empty where it is not known.
        sights: of each camera and source of poses, where they are asked for.
        began: time of the first entry [s].
        ended: time of the last entry [s].
    """

    vehicle: str
    entries: int = 0
    series: defaultdict[str, TimeSeries] = field(default_factory=lambda: defaultdict(TimeSeries))
    states: list[FlownState] = field(default_factory=list)
    troubles: list[Trouble] = field(default_factory=list)
    conditions: list[tuple[float, str]] = field(default_factory=list)
    happenings: list[EventLine] = field(default_factory=list)
    left_out: int = 0
    images: list[ImagePlace] = field(default_factory=list)
    last: dict[str, tuple[float, Mapping[str, Any]]] = field(default_factory=dict)
    reading: Reading = field(default_factory=Reading)
    parameters: bytes = b""
    model: Mapping[str, Any] = field(default_factory=dict)
    sights: dict[str, Sights] = field(default_factory=dict)
    began: float = 0.0
    ended: float = 0.0

    def has(self, name: str) -> bool:
        """Whether there is such a series."""
        return name in self.series

    def newest(self, suffix: str) -> Mapping[str, Any]:
        """The last value of a key; empty where there is none."""
        return self.last[suffix][1] if suffix in self.last else {}

    @property
    def cameras(self) -> list[str]:
        """Those that gave figures or poses."""
        known = {suffix.split("/")[1] for suffix in self.last if suffix.startswith("vision/")}
        return sorted(known | {name.removesuffix(_POSE) for name in self.series if name.endswith(_POSE)})

    @cached_property
    def gaps(self) -> list[tuple[float, float]]:
        """Blind flight: from the last image that was used until the next one [s], where that took too long."""
        found: list[tuple[float, float]] = []
        series = self.series.get("estimate.image_age")
        times, ages = (np.empty(0), np.empty(0)) if series is None else series.arrays()
        for at, age in zip(times.tolist(), ages.tolist(), strict=True):
            if age > DEAD_RECKONING:
                since = at - age
                found[-1:] = [(found[-1][0], at)] if found and since <= found[-1][1] else [*found[-1:], (since, at)]
        return found

    def is_blind(self, times: Array) -> npt.NDArray[np.bool_]:
        """Whether moments (n,) [s] are of blind flight."""
        found = np.zeros(len(times), dtype=bool)
        for begin, end in self.gaps:
            found |= (times >= begin) & (times <= end)
        return found

    @property
    def end(self) -> Picture:
        """What was known at the end."""
        return self.reading.at(self.ended)

    def keep(self, happening: EventLine) -> None:
        """Keep something that happened, if there is room."""
        if len(self.happenings) < MOST:
            self.happenings.append(happening)
        else:
            self.left_out += 1


class FlightReader:
    """Makes flights of entries.

    Attributes:
        flights: by vehicle.
    """

    def __init__(self, *, has_sights: bool = False) -> None:
        """Read; with `has_sights` every pose is kept whole as well, with what else of a camera a comparison needs."""
        self.flights: dict[str, RecordedFlight] = {}
        self._has_sights, self._origin = has_sights, 0
        self._owners: dict[tuple[EntryKind, str], str] = {}

    def taker(self, entry: Entry) -> Taker | None:
        """Who takes the entries of the kind and key of this one, the first; None where they are only counted."""
        self._origin = self._origin or entry.base.file_time(entry.received)
        self._owners[entry.kind, entry.key] = entry.vehicle
        flight = self.flights.setdefault(entry.vehicle, RecordedFlight(entry.vehicle))
        pattern, camera = _pattern_of(entry.suffix)
        if entry.kind is EntryKind.IMAGE or (entry.kind is EntryKind.SAMPLE and pattern == "vision/*/image"):
            return self._images(flight)
        use = _take_lost_line if entry.kind is EntryKind.PORT_LOST else _USES.get((entry.kind, pattern))
        if use is None and entry.kind is EntryKind.SAMPLE and (pattern in COLUMNS or pattern in LAST):
            use = _numbers_taker(pattern, camera)
        if self._has_sights and entry.kind is EntryKind.SAMPLE and (found := taken_by(entry.suffix)) is not None:
            use = _take_sights(flight.sights.setdefault(found[0], Sights()), found[1], use)
        return None if use is None else self._values(flight, entry.suffix, use)

    def count(self, summary: Summary) -> None:
        """Take what was counted, when everything has been read."""
        for vehicle, flight in self.flights.items():
            found = [summary.keys[place] for place, owner in self._owners.items() if owner == vehicle]
            flight.entries = sum(one.count for one in found)
            flight.began = min(0, *(one.first - self._origin for one in found)) / NANOSECONDS
            flight.ended = max(0, *(one.last - self._origin for one in found)) / NANOSECONDS
            for suffix, (at, fields) in flight.last.items():
                if (value := value_of(suffix, fields)) is not None:
                    flight.reading.take(suffix, value, at)

    def _images(self, flight: RecordedFlight) -> Taker:
        def take(entry: Entry, at: int) -> None:
            taken = (at - self._origin) / NANOSECONDS
            flight.images.append(ImagePlace(taken, entry.kind, entry.key, entry.sequence))

        return take

    def _values(self, flight: RecordedFlight, suffix: str, use: _Use) -> Taker:
        def take(entry: Entry, at: int) -> None:
            fields, moment = unpacked(entry.payload), (at - self._origin) / NANOSECONDS
            stamp = fields.get("stamp")
            if isinstance(stamp, dict) and stamp.get("boot") == entry.base.boot:
                stamped = number_of(stamp, "monotonic")
                if stamped is not None and abs(stamped - entry.received) < NEAR:
                    moment += stamped - entry.received
            flight.last[suffix] = (moment, fields)
            use(flight, moment, suffix, fields)

        return take


def _pattern_of(suffix: str) -> tuple[str, str]:
    """A key with `*` in place of the camera's name, and that name; empty where it has none."""
    first, _, rest = suffix.partition("/")
    if first != "vision":
        return suffix, ""
    camera, _, what = rest.partition("/")
    return f"vision/*/{what}", camera


def _numbers_taker(pattern: str, camera: str) -> _Use:
    """Keeps the numbers of one key in series of a flight."""
    before = f"{camera} " if camera else ""
    columns = [
        (path, tuple(before + name for name in names), factor) for path, names, factor in COLUMNS.get(pattern, ())
    ]

    def take(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
        for path, names, factor in columns:
            for name, number in zip(names, numbers_of(fields, path, len(names)), strict=False):
                flight.series[name].add(at, number * factor)

    return take


def _take_status(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
    take_causes(flight.troubles, at, fields)
    words = [text_of(fields, name) for name in ("phase", "manoeuvre", "stage", "reason", "outcome")]
    phase, manoeuvre, stage, reason, outcome = words
    state = FlownState(at, phase, manoeuvre, stage, part_of(fields, "is_done") is True, reason, outcome)
    if flight.states[-1:] != [state]:
        flight.states.append(state)


def _take_link(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
    condition = text_of(fields, "condition")
    if not flight.conditions or flight.conditions[-1][1] != condition:
        flight.conditions.append((at, condition))


def _take_happening(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
    if (line := happening_of(at, suffix, fields)) is not None:
        flight.keep(line)


def _take_lost_line(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
    flight.keep(lost_line(at, fields))


def _take_settings(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
    found = part_of(fields, "fields.parameters")
    if isinstance(found, bytes):
        flight.parameters = found


def _take_model(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
    found = part_of(fields, "event.model")
    if isinstance(found, Mapping):
        flight.model = found


def _take_sights(sights: Sights, take: Take, use: _Use | None) -> _Use:
    """Take values twice: for a comparison, and as without one."""

    def both(flight: RecordedFlight, at: float, suffix: str, fields: Mapping[str, Any]) -> None:
        take(sights, at, fields)
        if use is not None:
            use(flight, at, suffix, fields)

    return both


_Use = Callable[[RecordedFlight, float, str, Mapping[str, Any]], None]
_USES: Final[dict[tuple[EntryKind, str], _Use]] = {
    **{(EntryKind.SAMPLE, suffix): _take_happening for suffix in EVENTS},
    (EntryKind.SAMPLE, STATUS): _take_status,
    (EntryKind.SAMPLE, "link/state"): _take_link,
    (EntryKind.SAMPLE, "rx/fc/settings"): _take_settings,
    (EntryKind.EVENT, "core/ModelKnown"): _take_model,
}
"""What becomes of the entries of a kind and key; `COLUMNS` and `LAST` are kept, all others only counted."""
