"""Many demonstrations in virtual time: how many finish, and the longest holes in what a flight needs.

The flight is the one of `mkdaemon demo`: take-off, hold, a step, a target that starts to move, landing. What became of
it is read from the physics: where the aircraft stands, whether it broke, whether its rotors stand. The product's words
only explain a flight that did not finish.
"""

from __future__ import annotations

import json
import logging
import math
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import structlog
from pydantic import BaseModel

from mkdaemon.cli.arguments import AsJson
from mkdaemon.telemetry.control import ControlStatus
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.traffic import RawFrame
from mkdaemon.telemetry.vision import VisionPose
from mkdaemon.virtualtime import run_virtually
from mkdaemon.vision.pose.projection import Projection
from mksim.programs.rehearsal import Rehearsal, demonstration, simulated_aircraft
from mksim.scene.camera import BodyState

ON_TARGET: Final = 0.3
"""An aircraft that stands nearer to the middle of the target has landed on it [m]."""
STANDS: Final = 0.2
"""Its origin is lower than this above the target then [m]."""
STRAYED: Final = 6.0
"""An aircraft farther from the target than this is lost [m]: the fence is at 5 m."""
LOOK: Final = 0.02
"""Between two looks at the true state [s]."""
EDGE: Final = 3.0
"""A tag is in view where all its corners are so far inside the image [px]."""
LONGEST_ATTITUDE_HOLE: Final = 0.4
"""Goal of the campaign [s]."""
LONGEST_POSE_HOLE: Final = 0.5
"""Goal of the campaign, while the target is in view [s]."""


class Verdict(StrEnum):
    """What became of a flight."""

    FINISHED = "finished"
    """It stands on the target, whole, rotors still."""
    RELEASED = "released"
    """The daemon gave it back to the pilot before it had landed."""
    LOST = "lost"
    """It broke, or flew away."""


@dataclass(frozen=True, slots=True)
class Row:
    """One flight.

    Attributes:
        seed: of everything random.
        loss: share of radio packets lost each way; None for the radio's own.
        verdict: by the physics.
        reason: why it did not finish, in the daemon's words; empty where it did.
        touch_cm: distance from the middle of the target at the end.
        attitude_hole: longest time in the air without an attitude [s].
        pose_hole: longest time in the air without a pose while a tag was wholly in view [s].
        silence: longest time in the air in which no frame arrived at all [s], because the radio lost every packet.
        seconds: of the flight.
        processor: time that it took to compute [s].
    """

    seed: int
    loss: float | None
    verdict: Verdict
    reason: str
    touch_cm: float
    attitude_hole: float
    pose_hole: float
    silence: float
    seconds: float
    processor: float


@dataclass(slots=True)
class Watch:
    """Sees one flight from outside.

    Attributes:
        attitudes: arrivals in the air [s].
        poses: exposures that gave a pose [s].
        frames: arrivals of any frame of the board [s].
        looks: time, whether it is in the air, whether a tag is wholly in view.
        farthest: distance from the target in the air [m].
        reason: of the first release.
    """

    attitudes: list[float] = field(default_factory=list)
    poses: list[float] = field(default_factory=list)
    frames: list[float] = field(default_factory=list)
    looks: list[tuple[float, bool, bool]] = field(default_factory=list)
    farthest: float = 0.0
    reason: str = ""

    def attach(self, rehearsal: Rehearsal) -> None:
        """Follow a flight that has not begun."""
        scene, truth = rehearsal.scene, rehearsal.world.truth
        projection = Projection(scene.camera.intrinsics)
        width, height = scene.camera.intrinsics.width, scene.camera.intrinsics.height
        tags = [tag.corners for tag in scene.targets[0].tags]

        def take(suffix: str, value: BaseModel) -> None:
            if isinstance(value, Attitude):
                self.attitudes.append(value.stamp.monotonic)
            elif isinstance(value, VisionPose):
                self.poses.append(value.stamp.monotonic)
            elif isinstance(value, RawFrame) and suffix == "raw/rx":
                self.frames.append(value.stamp.monotonic)
            elif isinstance(value, ControlStatus) and value.phase.value == "releasing" and not self.reason:
                self.reason = value.reason

        def look(now: float) -> None:
            if self.looks and now - self.looks[-1][0] < LOOK:
                return
            state = BodyState(now, truth.position_enu, truth.velocity_enu, truth.enu_from_flu, truth.rates)
            view, pad = scene.view(state), scene.platform.pose_at(now)
            is_seen = False
            for corners in tags:
                pixels, is_in_front = projection.project(view.camera_points(pad.points(corners)))
                inside = (pixels > EDGE).all() and (pixels < (width - 1 - EDGE, height - 1 - EDGE)).all()
                is_seen |= bool(inside and is_in_front.all())
            self.looks.append((now, truth.airborne, is_seen))
            if truth.airborne:
                self.farthest = max(self.farthest, float(np.hypot(*(truth.position_enu - pad.position_enu)[:2])))

        rehearsal.bus.followers.append(take)
        rehearsal.watch_world(look)

    def hole(self, moments: list[float], until: float, *, in_view: bool) -> float:
        """Longest time in the air, before a time, without one of these moments; only while a tag is in view."""
        longest = held = 0.0
        coming = iter(moments)
        following = next(coming, math.inf)
        before = None
        for at, is_up, is_seen in self.looks:
            if at > until:
                break
            has_come = following <= at
            while following <= at:
                following = next(coming, math.inf)
            counts = is_up and (is_seen or not in_view)
            held = held + (at - before) if counts and before is not None and not has_come else 0.0
            before, longest = at, max(longest, held)
        return longest


def fly(seed: int, loss: float | None, wind: str, fps: float) -> Row:
    """Fly once."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    watch, began = Watch(), time.process_time()

    async def flight() -> Any:
        rehearsal = demonstration(simulated_aircraft(seed, wind, fps, loss), lambda moment, status: None)
        watch.attach(rehearsal)
        record = await rehearsal.fly()
        return record, rehearsal.world.truth.on_ground

    record, stands = run_virtually(flight(), 0.0)
    last = record.landing if record.landing is not None else (record.moments[-1] if record.moments else None)
    touch = math.nan if last is None else math.hypot(*last.position[:2])
    is_there = stands and last is not None and touch < ON_TARGET and last.position[2] < STANDS
    is_lost = bool(record.crashed) or watch.farthest > STRAYED
    finished = is_there and record.motors_stand and record.landing is not None and not is_lost
    verdict = Verdict.FINISHED if finished else Verdict.LOST if is_lost else Verdict.RELEASED
    ends = record.parts.get("after", math.inf)
    return Row(
        seed=seed,
        loss=loss,
        verdict=verdict,
        reason="" if finished else record.crashed or watch.reason or record.outcome or "it never began",
        touch_cm=round(100 * touch, 1) if math.isfinite(touch) else -1.0,
        attitude_hole=round(watch.hole(watch.attitudes, ends, in_view=False), 2),
        pose_hole=round(watch.hole(watch.poses, ends, in_view=True), 2),
        silence=round(watch.hole(watch.frames, ends, in_view=False), 2),
        seconds=round(record.moments[-1].at, 1) if record.moments else 0.0,
        processor=round(time.process_time() - began, 1),
    )


def flights(todo: list[tuple[int, float | None]], jobs: int, wind: str, fps: float) -> Iterator[Row]:
    """Fly in processes of their own, in the order in which they end."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[name] = "1"
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, spawn, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        for done in as_completed([pool.submit(fly, seed, loss, wind, fps) for seed, loss in todo]):
            yield done.result()


def summary(rows: list[Row]) -> dict[str, Any]:
    """Figures of flights under one radio."""
    counts = {verdict.value: sum(row.verdict is verdict for row in rows) for verdict in Verdict}
    return {
        "flights": len(rows),
        **counts,
        "attitude_hole_s": max((row.attitude_hole for row in rows), default=0.0),
        "pose_hole_s": max((row.pose_hole for row in rows), default=0.0),
        "silence_s": max((row.silence for row in rows), default=0.0),
        "attitude_holes_too_long": sum(row.attitude_hole > LONGEST_ATTITUDE_HOLE for row in rows),
        "radio_silences_too_long": sum(row.silence > LONGEST_ATTITUDE_HOLE for row in rows),
        "pose_holes_too_long": sum(row.pose_hole > LONGEST_POSE_HOLE for row in rows),
        "unfinished": [f"{row.seed}: {row.verdict.value}: {row.reason}" for row in rows if row.reason],
    }


def main(
    *,
    seeds: int = 200,
    first: int = 1,
    loss: tuple[float, ...] = (),
    wind: str = "light",
    fps: float = 15.0,
    jobs: int = 2,
    results: Path | None = None,
    as_json: AsJson = False,
) -> int:
    """Fly the demonstration with many seeds; half a minute of processor time a flight.

    Args:
        seeds: flights under each radio.
        first: seed.
        loss: shares of radio packets lost each way, one campaign for each; the radio's own (1 %) where none is given.
        wind: none, indoor, light or moderate.
        fps: images a second.
        jobs: processes.
        results: file of rows, one JSON object a line; a run that was interrupted goes on with it.
    """
    rows: list[Row] = []
    if results is not None and results.exists():
        lines = results.read_text(encoding="utf-8").splitlines()
        rows = [Row(**{**each, "verdict": Verdict(each["verdict"])}) for each in map(json.loads, lines)]
    known = {(row.seed, row.loss) for row in rows}
    wanted = [(seed, share) for seed in range(first, first + seeds) for share in (loss or (None,))]
    todo = [each for each in wanted if each not in known]
    began = time.monotonic()
    for count, row in enumerate(flights(todo, jobs, wind, fps), start=1):
        rows.append(row)
        if results is not None:
            with results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(row)) + "\n")
        left = (time.monotonic() - began) / count * (len(todo) - count)
        holes = f"holes {row.attitude_hole:.2f} {row.pose_hole:.2f} {row.silence:.2f} s"
        words = f"{row.verdict.value} {row.reason} {holes}"
        print(f"{count} of {len(todo)}, {left / 60:.0f} min left: {row.seed} {words}", file=sys.stderr, flush=True)
    by_loss = {
        share: [row for row in rows if (row.seed, row.loss) in set(wanted) and row.loss == share]
        for share in (loss or (None,))
    }
    found = {"own" if share is None else f"{share:g}": summary(flown) for share, flown in by_loss.items()}
    if as_json:
        print(json.dumps(found))
    else:
        for share, figures in found.items():
            print(f"radio loss {share}")
            for name, value in figures.items():
                print(f"  {name:<26} {value}")
    return 0 if all(row.verdict is Verdict.FINISHED for flown in by_loss.values() for row in flown) else 1
