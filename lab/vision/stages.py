"""Where the time of an image goes: every stage of the tracker on a troubled flight, by the profiler."""

from __future__ import annotations

import cProfile
import pstats
import time
from collections.abc import Callable
from typing import Any, Final

from lab.vision.flight import LOOKING_DOWN, VGA, FlightFrame, fly
from lab.vision.stills import SeedSet, target_named
from mkdaemon.vision.pose.edgefit import EdgeFit
from mkdaemon.vision.pose.fitting import TargetFitter
from mkdaemon.vision.pose.gates import CellReader
from mkdaemon.vision.pose.photofit import PhotoFit
from mkdaemon.vision.tags.detector import Detector
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.track.branches import Branches
from mkdaemon.vision.track.follower import Track
from mkdaemon.vision.track.tracker import ImageHealth, Tracker

STAGES: Final[dict[str, tuple[Callable[..., Any], ...]]] = {
    "health": (ImageHealth.check,),
    "prediction": (Track.predict,),
    "edge fit": (EdgeFit.fit,),
    "grey-value fit": (PhotoFit.fit,),
    "cells": (CellReader.evidence, CellReader.shows, CellReader.beside),
    "evidence": (EdgeFit.evidence,),
    "branches": (Branches.after,),
    "carry": (TargetFitter.carried,),
    "search": (Detector.search,),
}
"""Functions of each stage; none of them calls another one of the table."""


def stages(quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Milliseconds of one core an image takes in each stage, with and without attitude, on a flight a target."""
    seconds = 2.0 if quick else 8.0
    out: dict[str, Any] = {"images": 0}
    flights = {name: list(fly(target_named(name), seeds.base + 820, seconds=seconds)) for name in ("nested", "single")}
    out["images"] = sum(len(frames) for frames in flights.values())
    for known, words in ((True, "with_attitude"), (False, "without_attitude")):
        plain = sum(seconds_of(name, frames, known=known) for name, frames in flights.items())
        profile = cProfile.Profile()
        for name, frames in flights.items():
            profile.enable()
            seconds_of(name, frames, known=known)
            profile.disable()
        out[words] = _shares(profile, 1000.0 * plain / out["images"])
    return out


def seconds_of(name: str, frames: list[FlightFrame], *, known: bool) -> float:
    """Time of one core that the tracker takes for a flight, its attitude known or not [s]."""
    tracker = Tracker(TagMap((target_named(name),)), VGA, LOOKING_DOWN)
    start = time.process_time()
    for frame in frames:
        tracker.update(frame.image, frame.attitude if known else None)
    return time.process_time() - start


def _shares(profile: cProfile.Profile, ms: float) -> dict[str, float]:
    """Times by stage [ms]: shares by the profiler, of the time without it."""
    statistics = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    spent = {(file, line, name): row[3] for (file, line, name), row in statistics.items()}

    def seconds(function: Callable[..., Any]) -> float:
        code = function.__code__
        return float(spent.get((code.co_filename, code.co_firstlineno, code.co_name), 0.0))

    whole = seconds(Tracker.update)
    found = {name: ms * sum(map(seconds, functions)) / whole for name, functions in STAGES.items()}
    found["rest"] = ms - sum(found.values())
    return {"whole": round(ms, 2), **{name: round(value, 2) for name, value in found.items()}}
