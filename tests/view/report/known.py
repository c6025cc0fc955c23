"""Recordings of a flight of which every number is known."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import cv2
import msgpack
import numpy as np
from pydantic import BaseModel

from mkdaemon.bus.codec import schema_name
from mkdaemon.reading import Reading, key_spec
from mkdaemon.record.entry import Entry, EntryKind, TimeBase
from mkdaemon.record.layout import Session
from mkdaemon.record.writer import RecordingWriter
from tests import samples

BASE = TimeBase("0123abcd", 1_760_000_000_000_000_000)
BEGIN = 1000.0
"""Monotonic time of the first entry [s]."""
PACK = "application/msgpack;mk.Some.v1"
STATES = (
    (0.0, "free", None, "", False, "no lease was requested yet", None),
    (1.0, "flying", "takeoff", "climbs", False, "pilot flies", None),
    (3.0, "flying", "position", "", False, "pilot flies", None),
    (6.0, "flying", "position", "", True, "pilot flies", None),
    (9.0, "releasing", "position", "", True, "landed on pad", "landed"),
    (9.5, "free", None, "", False, "landed on pad", "landed"),
)
"""Time [s], phase, manoeuvre, stage, is_done, reason, outcome."""


def error_at(at: float) -> tuple[float, float, float]:
    """Estimate less goal [m]: 5 cm horizontally once it is there, 20 cm before."""
    return (0.03, 0.04, -0.02) if at >= 6.0 else (0.12, 0.16, 0.5)


class Tape:
    """Collects entries of one vehicle; those that are given first, each as time [s], key and fields."""

    def __init__(self, *entries: tuple[float, str, Any], vehicle: str = "mk1") -> None:
        self.vehicle = vehicle
        self.entries: list[Entry] = []
        self._counts: dict[tuple[EntryKind, str], int] = {}
        for entry in entries:
            self.add(*entry)

    def add(self, at: float, suffix: str, fields: Any, kind: EntryKind = EntryKind.SAMPLE, **more: Any) -> None:
        """Add an entry of a time [s] after the beginning."""
        monotonic, key = BEGIN + at, f"mk/{self.vehicle}/{suffix}"
        if isinstance(fields, BaseModel):
            fields = fields.model_dump(mode="json", exclude={"stamp"})
        payload = msgpack.packb({"stamp": self.stamp(at)} | fields if isinstance(fields, dict) else fields)
        number = self._counts[kind, key] = self._counts.get((kind, key), 0) + 1
        wall = 1_760_001_000.0 + at
        carried = None if (spec := key_spec(suffix)) is None else spec.carries
        encoding = PACK if carried is None else f"application/msgpack;mk.{schema_name(carried)}"
        self.entries.append(Entry(kind, key, payload, encoding, monotonic, wall, BASE, number, **more))

    @staticmethod
    def stamp(at: float) -> dict[str, Any]:
        """The stamp of a time [s] after the beginning."""
        return {"monotonic": BEGIN + at, "wall": 1_760_001_000.0 + at, "boot": BASE.boot, "synchronised": True}

    def write(self, path: Path, config: str = "") -> Path:
        """Write a recording, in the order of time."""
        name = f"known-{self.vehicle}"
        session = Session("blackbox", name, 0, "mkdaemon 1", "box", BASE.boot, BASE.offset_ns, self.vehicle, config)
        with path.open("wb") as file:
            writer = RecordingWriter(file, session)
            for entry in sorted(self.entries, key=lambda entry: entry.received):
                writer.add(entry)
            writer.finish()
        return path


def picture(grey: int) -> dict[str, Any]:
    """An image of one grey."""
    pixels = cv2.imencode(".png", np.full((60, 80), grey, np.uint8))[1].tobytes()
    return {"camera": "down", "sequence": 1, "width": 80, "height": 60, "coding": "png", "pixels": pixels}


def known_flight(word: str = "", vehicle: str = "mk1") -> Tape:
    """Ten seconds: a climb, a place at (1, 0, 2) that is reached after 3 s, and how it ended.

    Args:
        word: is put into every text that others write.
        vehicle: that flies.
    """
    tape = Tape(vehicle=vehicle)
    for at, phase, manoeuvre, stage, is_done, reason, outcome in STATES:
        flown = {"manoeuvre": manoeuvre, "stage": stage + word if stage else "", "is_done": is_done}
        tape.add(at, "control/status", {"phase": phase, "reason": reason + word, "outcome": outcome, **flown})
    for tick in range(20 * 8):
        at = 1.0 + tick / 20
        error, goal = error_at(at), (1.0, 0.0, 2.0)
        position = [one + other for one, other in zip(goal, error, strict=True)]
        tape.add(at, "control/estimate", {"position": position, "target": word})
        tape.add(at, "control/error", {"goal": goal, "error_pad": error, "manoeuvre": "position" + word})
        tape.add(at, "state/altitude", {"above_start": math.floor(at)})
    link = {"reason": word, "port": "/dev/x" + word, "baud": 57600, "firmware": "FlightCtrl 2.12a" + word}
    link |= {"hears_board": True, "board_hears_us": True}
    for tick in range(11):
        at = float(tick)
        battery = {"voltage": 16.0 - 0.1 * tick, "current": 10.0, "used_mah": 3.0 * tick}
        tape.add(at, "state/battery", battery | {"source": "nc/osd", "is_low": False})
        echo = {"sent_total": 100, "lost_total": 2, "p50_ms": 20.0, "p95_ms": 30.0 + tick, "loss_percent": 2.0}
        tests = {"sent": 100, "answered": 97, "late": 1, "unanswered": 2, "lost": 2}
        condition = "up" if at < 8.0 else "degraded"
        state = link | {"condition": condition, "stamp": tape.stamp(at), "since": tape.stamp(0.0)}
        tape.add(at, "link/health", {"state": state, "echo": echo, "confirm": {}, "link_tests": tests})
        stats = {"reason": word, "posed": 0.5, "processed": 10 * tick, "fps": 10.0, "source": "/dev/video0"}
        stats |= {"latency_p50_ms": 60.0, "latency_p99_ms": 70.0, "detect_p50_ms": 5.0, "detect_p99_ms": 6.0}
        tape.add(at, "vision/down/stats", samples.eyes(at, width=80, height=60, **stats))
        tape.add(at, "vision/down/image", picture(20 * tick), EntryKind.IMAGE, issuer="driver")
    for at, condition in ((0.0, "up"), (8.0, "degraded")):
        tape.add(at, "link/state", {"condition": condition, "since": tape.stamp(at), **link})
    tape.add(0.0, "health", samples.alive(firmware={"fc": "2.12a" + word}, note=word))
    _add_events(tape, word)
    return tape


def _add_events(tape: Tape, word: str) -> None:
    refusal = {"token": "not_leased" + word, "reason": "nobody holds it" + word, "fix": "take" + word}
    tape.add(0.5, "event/command", {"key": "do/lease", "fields": {"holder": "me" + word}, "status": "accepted"})
    for at in (2.0, 9.7):
        tape.add(at, "event/command", {"key": "setpoint/land", "fields": {}, "status": "denied", **refusal})
    tape.add(1.0, "event/mode", {"before": "leased", "after": "flying", "reason": "me" + word})
    tape.add(4.0, "event/mark", {"text": "here" + word, "holder": ""})
    tape.add(5.0, "event/failsafe", {"action": "neutral", "reason": "too old" + word, "released": None})
    tape.add(5.5, "event/log", {"level": "warning", "text": "look" + word})
    model = {"a1": 3.5, "stick_filter": 0.078}
    tape.add(0.1, "core/ModelKnown", {"event": {"model": model}, "reply": None}, EntryKind.EVENT)


def taped(situation):
    """A recording of a situation of tests/reading, and the picture of its end."""
    tape, reading = Tape(), Reading()
    for key, value in situation.values.items():
        tape.add(value.stamp.monotonic - BEGIN, key, value)
        reading.take(key, value, value.stamp.monotonic)
    return tape, reading.at(BEGIN)


def write_known(path: Path, word: str = "") -> Path:
    """Write the flight; see `known_flight`."""
    return known_flight(word).write(path, json.dumps({"vehicle": {"note": "as it was" + word}}))
