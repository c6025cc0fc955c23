"""Situations that every screen must say in the same words: generated from the closed sets, none of them by hand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from mkdaemon.bus.keys import fresh_for
from mkdaemon.reading.alarms import STREAMS
from mkdaemon.reading.facts import FLIGHT_ALARMS
from mkdaemon.telemetry.control import CauseKind, Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.vision import Alarm, EyeState
from tests.reading.knownflight import KNOWN
from tests.values import made

AT = KNOWN["health"].stamp
"""When the values were published."""
RECORDER = made(RecordStatus, AT, state=RecorderState.RECORDING, file="a.mcap")
BASE = {key: value for key, value in KNOWN.items() if not key.startswith("event/")} | {"record/status": RECORDER}
"""A flight by the target in which nothing is wrong."""
LINK = BASE["link/state"].model_dump()


@dataclass(frozen=True)
class Situation:
    """What is wrong.

    Attributes:
        name: of it.
        changes: fields of values, by key.
        ages: of values that came long ago [s], by key.
    """

    name: str
    changes: dict[str, dict[str, Any]] = field(default_factory=dict)
    ages: dict[str, float] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, Any]:
        """The values of the flight, so changed, each with the stamp that its age gives it."""
        found = {}
        for key, value in BASE.items():
            fields = value.model_dump() | self.changes.get(key, {})
            at = AT.monotonic - self.ages.get(key, 0.0)
            fields["stamp"] = AT.model_copy(update={"monotonic": at, "wall": AT.wall - self.ages.get(key, 0.0)})
            found[key] = type(value).model_validate(fields)
        return found


def _single() -> Iterator[Situation]:
    yield Situation("all is well")
    for phase in Phase:
        yield Situation(f"phase {phase}", {"control/status": {"phase": phase}})
    for condition in LinkCondition:
        state = LINK | {"condition": condition, "reason": "as it was seen"}
        yield Situation(f"link {condition}", {"link/state": state, "link/health": {"state": state}})
    for eye in EyeState:
        yield Situation(f"eye {eye}", {"vision/down/stats": {"state": eye, "reason": "look there"}})
    for alarm in Alarm:
        yield Situation(f"alarm {alarm}", {"vision/down/stats": {"alarms": {alarm: "do this"}}})
    for state in RecorderState:
        yield Situation(f"recorder {state}", {"record/status": {"state": state, "reason": "so it is"}})
    for flag in FLIGHT_ALARMS:
        yield Situation(f"flag {flag}", {"state/flight": {flag: True}})
    for kind in CauseKind:
        trouble = f"NO POSE FOR 1.2 S, releases in 1.8 s: {kind}"
        yield Situation(f"cause {kind}", {"control/status": {"trouble": trouble}})
    for voltage in (13.6, 11.6):
        yield Situation(f"battery {voltage} V", {"state/battery": {"voltage": voltage}})
    yield Situation("battery low", {"state/battery": {"is_low": True}})
    yield Situation("no receiver", {"state/pilot": {"has_signal": False, "rc_quality": 0.1}})
    yield Situation("throttle down", {"control/status": {"pilots_throttle": -30.0, "hands": "must raise his throttle"}})
    yield Situation("error", {"health": {"error": "no compass"}})
    yield Situation("read only", {"health": {"read_only": "an unknown release"}})
    yield Situation("silent aircraft", {"health": {"is_alive": False, "reason": "no frame for 3 s"}})
    yield Situation("open bus", {"health": {"open_endpoints": ("tcp/0.0.0.0:7447",)}})
    for key in STREAMS:
        yield Situation(f"lost {key}", ages={key: 2.0 * (fresh_for(key) or 0.0)})
    eyes = [key for key in BASE if key.startswith("vision/")]
    yield Situation("lost camera", ages=dict.fromkeys(eyes, 10.0))
    yield Situation("lost target", {"control/status": {"pose_age": 2.0}}, ages={"vision/down/pose": 2.0})
    yield Situation("lost daemon", ages=dict.fromkeys(BASE, 10.0))


SITUATIONS = tuple(_single())
LOOKED_AT = tuple(one for one in SITUATIONS if one.name in {"all is well", "battery 11.6 V", "lost target"})
"""Those that are looked at in a browser."""
