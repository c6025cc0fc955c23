"""The manoeuvres of a flight, cut into their stages and places, each with its errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from mkdaemon.view.report.flight import FlownState, RecordedFlight
from mkdaemon.view.report.timeseries import Array

SETTLING: Final = 2.0
"""Errors of a manoeuvre that stays at a place are counted after this [s], unless it says itself that it is there."""
SAME_PLACE: Final = 0.05
"""Goals that are nearer to each other are one [m]."""
STAYS: Final = 1.0
"""A goal that lasts for less is only passed [s], and gets no place in the report."""
Goal = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Errors:
    """How far the aircraft was seen to be from its goal.

    Attributes:
        count: values.
        level_rms_cm: horizontal.
        level_max_cm: horizontal.
        height_rms_cm: vertical.
        height_max_cm: vertical.
    """

    count: int
    level_rms_cm: float
    level_max_cm: float
    height_rms_cm: float
    height_max_cm: float


@dataclass(frozen=True, slots=True)
class Piece:
    """One stage of a manoeuvre, or one place that it flew to.

    Attributes:
        manoeuvre: its kind.
        stage: of it; empty where it has none.
        begin: [s].
        end: [s].
        goal: that it flew to, from the middle of the target [m]; None where it moves or there is none.
        reached: how long after its beginning it said that it is there [s]; None where it did not.
        errors: after it was there or had settled; None where none is known.
        level_end_cm: horizontal error at its end; None where none is known.
        blind: seconds of blind flight, which the errors leave out.
    """

    manoeuvre: str
    stage: str
    begin: float
    end: float
    goal: Goal | None
    reached: float | None
    errors: Errors | None
    level_end_cm: float | None
    blind: float = 0.0

    @property
    def name(self) -> str:
        """Manoeuvre and stage in words."""
        return f"{self.manoeuvre}: {self.stage}" if self.stage else self.manoeuvre


class Settled(NamedTuple):
    """How well the places were held that a flight flew to.

    Attributes:
        rms_cm: distance from the goal, horizontally [cm, RMS].
        worst_cm: the largest [cm].
        worst: where that was.
        blind: how long of the flight is left out [s].
    """

    rms_cm: float
    worst_cm: float
    worst: Piece
    blind: float

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> Settled | None:
        """Sum up pieces; None where none of them has errors of a place."""
        found = [(piece, piece.errors) for piece in pieces if piece.errors is not None and not piece.stage]
        if not found:
            return None
        squares = sum(errors.count * errors.level_rms_cm**2 for _, errors in found)
        worst, errors = max(found, key=lambda one: one[1].level_max_cm)
        rms = math.sqrt(squares / sum(errors.count for _, errors in found))
        return cls(rms, errors.level_max_cm, worst, sum(piece.blind for piece in pieces))

    @property
    def left_out(self) -> str:
        """What the figures leave out, half a sentence; empty for nothing."""
        return f"; {self.blind:.1f} s of blind flight are left out" if self.blind else ""


@dataclass(frozen=True, slots=True)
class _Track:
    """Errors and goals over time: (n,), (n, 3), (n, 3)."""

    times: Array
    errors: Array
    goals: Array

    @classmethod
    def of(cls, flight: RecordedFlight) -> _Track:
        if not flight.has("error.x") or len(flight.series["error.x"]) != len(flight.series.get("goal.x", ())):
            return cls(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))
        parts = {name: [flight.series[f"{name}.{axis}"].arrays() for axis in "xyz"] for name in ("error", "goal")}
        times = parts["error"][0][0]
        errors, goals = (np.column_stack([values for _, values in parts[name]]) for name in ("error", "goal"))
        is_seen = ~flight.is_blind(times)
        return cls(times[is_seen], errors[is_seen], goals[is_seen])

    def between(self, begin: float, end: float) -> _Track:
        first, last = np.searchsorted(self.times, [begin, end])
        return _Track(self.times[first:last], self.errors[first:last], self.goals[first:last])


def pieces_of(flight: RecordedFlight) -> list[Piece]:
    """Every stage of every manoeuvre of a flight, in order."""
    track = _Track.of(flight)
    found: list[Piece] = []
    for states, end in _stages(flight):
        begin = states[0].at
        for start, stop, goal in _places(track.between(begin, end), begin, end, is_staged=bool(states[0].stage)):
            blind = sum(max(min(end, stop) - max(begin, start), 0.0) for begin, end in flight.gaps)
            found.append(replace(_piece(states, track.between(start, stop), start, stop, goal), blind=blind))
    return found


def _stages(flight: RecordedFlight) -> Iterator[tuple[list[FlownState], float]]:
    """States of one manoeuvre and stage, and when they end [s]."""
    group: list[FlownState] = []
    for state in flight.states:
        is_same = bool(group) and (state.manoeuvre, state.stage) == (group[0].manoeuvre, group[0].stage)
        if group and not (is_same and state.is_flown):
            yield group, state.at
            group = []
        if state.is_flown and state.manoeuvre:
            group.append(state)
    if group:
        yield group, flight.ended


def _places(track: _Track, begin: float, end: float, *, is_staged: bool) -> list[tuple[float, float, Goal | None]]:
    """A manoeuvre without stages cut where its goal goes to another place: begin, end [s], goal [m]."""
    if is_staged or not len(track.times):
        return [(begin, end, None if is_staged else _goal(track))]
    steps = np.abs(np.diff(track.goals, axis=0)).max(axis=1) > SAME_PLACE
    starts = [0, *(np.flatnonzero(steps) + 1).tolist()]
    stops = [*starts[1:], len(track.times)]
    places: list[tuple[float, Goal]] = []
    for start, stop in zip(starts, stops, strict=True):
        at = begin if start == 0 else float(track.times[start])
        until = end if stop == len(track.times) else float(track.times[stop])
        goal = _as_goal(track.goals[stop - 1])
        is_new = not places or math.dist(goal, places[-1][1]) > SAME_PLACE
        if is_new and (until - at >= STAYS or not places):
            places.append((at, goal))
    edges = [at for at, _ in places[1:]] + [end]
    return [(at, until, goal) for (at, goal), until in zip(places, edges, strict=True)]


def _goal(track: _Track) -> Goal | None:
    return _as_goal(track.goals[-1]) if len(track.times) else None


def _as_goal(row: Array) -> Goal:
    x, y, z = row.tolist()
    return x, y, z


def _piece(states: list[FlownState], track: _Track, begin: float, end: float, goal: Goal | None) -> Piece:
    first = states[0]
    reached = next((state.at for state in states if state.is_done and begin <= state.at < end), None)
    since = begin
    if not first.stage:
        since = min(begin + SETTLING if reached is None else reached, end)
    level = np.hypot(track.errors[:, 0], track.errors[:, 1])
    return Piece(
        manoeuvre=first.manoeuvre,
        stage=first.stage,
        begin=begin,
        end=end,
        goal=goal,
        reached=None if reached is None or first.stage else reached - begin,
        errors=_errors(track.between(since, end)),
        level_end_cm=100.0 * float(level[-1]) if len(level) else None,
    )


def _errors(track: _Track) -> Errors | None:
    if not len(track.times):
        return None
    level, height = 100.0 * np.hypot(track.errors[:, 0], track.errors[:, 1]), 100.0 * np.abs(track.errors[:, 2])
    return Errors(
        count=len(track.times),
        level_rms_cm=math.sqrt(float((level**2).mean())),
        level_max_cm=float(level.max()),
        height_rms_cm=math.sqrt(float((height**2).mean())),
        height_max_cm=float(height.max()),
    )
