"""What is wrong, the worst first: one list of checks for every screen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

from mkdaemon.reading.facts import (
    RANKS,
    SIGHT,
    age_words,
    battery_alarm,
    because,
    flight_alarms,
    phase_words,
    pose_age,
)
from mkdaemon.reading.known import Knowledge
from mkdaemon.spelling import on_one_line
from mkdaemon.telemetry.base import Stamped
from mkdaemon.telemetry.control import ControlEstimate, ControlStatus
from mkdaemon.telemetry.record import RecordStatus
from mkdaemon.telemetry.setpoint import SETPOINTS, TargetSetpoint
from mkdaemon.telemetry.state import Battery, Flight, Pilot
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import VisionStats


@dataclass(frozen=True, slots=True)
class RaisedAlarm:
    """Something wrong.

    Attributes:
        id: stable word.
        text: what it is, one line.
        tone: `warn` or `bad`.
    """

    id: str
    text: str
    tone: Tone


BY_TARGET: Final = frozenset(kind.suffix.rpartition("/")[2] for kind in SETPOINTS if issubclass(kind, TargetSetpoint))
"""Manoeuvres that need a target in sight."""
STREAMS: Final = {
    "control/status": "control",
    "health": "signs of life",
    "link/health": "link",
    "state/attitude": "attitude",
    "state/flight": "flight state",
    "state/battery": "battery",
    "state/pilot": "receiver",
}
"""Streams that never end while the aircraft and its daemon are well."""


def is_known(known: Knowledge) -> bool:
    """Whether everything is known that must be known before a state is called good."""
    return known.link() is not None and all(
        known.fresh(key, kind) is not None
        for key, kind in (("health", VehicleHealth), ("control/status", ControlStatus))
    )


def alarms_of(known: Knowledge, absence: str = "") -> tuple[RaisedAlarm, ...]:
    """Everything that is wrong, the worst first.

    Args:
        known: last values.
        absence: why no program publishes for the vehicle; empty while one does.
    """
    if absence:
        return (RaisedAlarm("absent", on_one_line(absence), Tone.BAD),)
    if known.is_silent:
        words = "no value has arrived" if math.isinf(known.silence) else f"silent for {age_words(known.silence)}"
        return (RaisedAlarm("silent", f"NOTHING FROM THE DAEMON: {words}", Tone.BAD),)
    found: list[RaisedAlarm] = []
    for name, look in _LOOKS.items():
        for alarm in known.remembered(name, look):
            if not any(one.text.startswith(alarm.text) for one in found):  # two values can say the same
                found.append(alarm)
    return tuple(sorted(found, key=lambda alarm: -RANKS.index(alarm.tone)))


def _alarms(check: Callable[[Knowledge], Iterator[_Check]], known: Knowledge) -> tuple[RaisedAlarm, ...]:
    """What a check finds wrong."""
    return tuple(RaisedAlarm(word, on_one_line(text), tone) for word, text, tone in check(known) if tone.is_wrong)


_Check = tuple[str, str, Tone]


def _aircraft(known: Knowledge) -> Iterator[_Check]:
    health, flight = known.fresh("health", VehicleHealth), known.fresh("state/flight", Flight)
    if health is not None and not health.is_alive:
        yield "aircraft", f"THE AIRCRAFT IS SILENT: {health.reason}", Tone.BAD
    if flight is not None and flight.emergency_landing:
        yield "emergency", "EMERGENCY LANDING: receiver lost", Tone.BAD


def _authority(known: Knowledge) -> Iterator[_Check]:
    """The holder, what keeps the flight back, and the pilot's hands."""
    status = known.fresh("control/status", ControlStatus)
    if status is None:
        return
    if status.trouble:
        yield "trouble", status.trouble, Tone.BAD
    if status.pilots_throttle is not None:
        yield "hands", f"The pilot {status.hands}", Tone.BAD
    yield "phase", phase_words(status), status.phase.tone
    if status.phase.is_in_flight and status.manoeuvre in BY_TARGET and not status.trouble:
        age = pose_age(known)
        if age is None or age > SIGHT:
            yield "pose", f"NO POSE {'yet' if age is None else f'for {age_words(age)}'}", Tone.WARN


def _error(known: Knowledge) -> Iterator[_Check]:
    health = known.fresh("health", VehicleHealth)
    if health is not None and health.error:
        yield "error", f"ERROR: {health.error}", Tone.BAD


def _receiver(known: Knowledge) -> Iterator[_Check]:
    if (pilot := known.fresh("state/pilot", Pilot)) is not None and not pilot.has_signal:
        yield "receiver", f"NO RECEIVER SIGNAL: {100 * pilot.rc_quality:.0f} %", Tone.BAD


def _battery(known: Knowledge) -> Iterator[_Check]:
    battery = known.fresh("state/battery", Battery)
    if battery is not None and (alarm := battery_alarm(battery, known)) is not None:
        yield "battery", *alarm


def _link(known: Knowledge) -> Iterator[_Check]:
    if (link := known.link()) is not None:
        condition = link.value.condition
        yield "link", because(f"LINK {condition.words.upper()}", link.value.reason), condition.tone


def _eyes(known: Knowledge) -> Iterator[_Check]:
    estimate = known.fresh("control/estimate", ControlEstimate)
    if estimate is not None and estimate.contradicting:
        yield "contradiction", f"CAMERAS CONTRADICT: {', '.join(estimate.contradicting)} not used", Tone.BAD
    for camera in known.cameras():
        stats = known.last(f"vision/{camera}/stats", VisionStats)
        if stats is None:
            continue
        if known.is_stale(stats):
            yield "eyes", f"camera {camera} silent for {age_words(known.age(stats))}", Tone.WARN
            continue
        state = stats.value.state
        yield "eyes", because(f"camera {camera} {state.words}", stats.value.reason), state.tone
        for alarm, text in stats.value.alarms.items():
            yield "eyes", f"camera {camera} {alarm.replace('_', ' ')}: {text}", Tone.WARN


def _flags(known: Knowledge) -> Iterator[_Check]:
    if (flight := known.fresh("state/flight", Flight)) is not None:
        yield from (("flight", words, tone) for words, tone in flight_alarms(flight))


def _silences(known: Knowledge) -> Iterator[_Check]:
    """Streams that have ended; those of a silent aircraft are no news."""
    health = known.fresh("health", VehicleHealth)
    for key, name in STREAMS.items():
        if key.startswith("state/") and health is not None and not health.is_alive:
            continue
        found = known.last(key, Stamped)
        if found is not None and known.is_stale(found):
            yield "stale", f"{name} silent for {age_words(known.age(found))}", Tone.WARN


def _rest(known: Knowledge) -> Iterator[_Check]:
    health = known.fresh("health", VehicleHealth)
    if health is not None and health.read_only:
        yield "read_only", f"READ ONLY: {health.read_only}", Tone.WARN
    if health is not None and health.open_endpoints:
        yield "open", f"OPEN: any client in the network may fly, at {', '.join(health.open_endpoints)}", Tone.WARN
    status = known.fresh("record/status", RecordStatus)
    if status is not None:
        yield "recorder", because(status.state.words, status.reason), status.state.tone
        if status.lost:
            yield "recorder", f"{status.lost} entries of the recording are lost", Tone.WARN


_CHECKS: Final = (_aircraft, _authority, _error, _receiver, _battery, _link, _eyes, _flags, _silences, _rest)
"""In order: of alarms that are equally bad the first is the worst."""
_LOOKS: Final = {f"alarms of {check.__name__}": partial(_alarms, check) for check in _CHECKS}
