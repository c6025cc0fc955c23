"""Many demonstrations in virtual time: how many finish, and the longest holes in what a flight needs.

The flight is the one of `mkdaemon demo`: take-off, hold, a step, a target that starts to move, landing. What became of
it is read from the physics; the product's words only explain a flight that did not finish.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from pydantic import BaseModel

from lab.campaign import Campaign, Ending, First, Jobs, Kept, Row, summed_up
from lab.cases import silence_log
from lab.tables import show
from mkdaemon.cli.arguments import AsJson
from mkdaemon.telemetry.control import ControlStatus
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.traffic import RawFrame
from mkdaemon.telemetry.vision import VisionPose
from mkdaemon.virtualtime import run_virtually
from mkdaemon.vision.pose.projection import Projection
from mksim.programs.flightrecord import Rehearsed
from mksim.programs.rehearsal import Rehearsal, Watcher, demonstration, simulated_aircraft
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
HOLES: Final = {"attitude_hole": 0.4, "pose_hole": 0.5, "silence": 0.4}
"""Of each kind of hole the longest that is right [s]."""


@dataclass(slots=True)
class Watch:
    """Sees one flight from outside.

    Attributes:
        attitudes: arrivals in the air [s].
        poses: exposures that gave a pose [s].
        frames: arrivals of any frame of the board [s].
        looks: time, whether it is in the air, whether a tag is wholly in view.
    """

    attitudes: list[float] = field(default_factory=list)
    poses: list[float] = field(default_factory=list)
    frames: list[float] = field(default_factory=list)
    looks: list[tuple[float, bool, bool]] = field(default_factory=list)

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


def fly(flight: Row) -> Row:
    """Fly once.

    Args:
        flight: `seed`, `loss` (share of radio packets lost each way; None for the radio's own), `wind` and `fps`.

    Returns:
        How it ended and why; `touch_cm` from the middle of the target at the end; the longest times in the air without
        an attitude (`attitude_hole`), without a pose while a tag was wholly in view (`pose_hole`), and without any
        frame because the radio lost every packet (`silence`); its length [s].
    """
    watch = Watch()

    def prepare(follow: Watcher) -> Rehearsal:
        rehearsal = demonstration(simulated_aircraft(**flight), follow)
        watch.attach(rehearsal)
        return rehearsal

    record, row = flown(prepare, STRAYED)
    ends = record.parts.get("after", math.inf)
    return row | {
        "attitude_hole": round(watch.hole(watch.attitudes, ends, in_view=False), 2),
        "pose_hole": round(watch.hole(watch.poses, ends, in_view=True), 2),
        "silence": round(watch.hole(watch.frames, ends, in_view=False), 2),
    }


def flown(prepare: Callable[[Watcher], Rehearsal], strayed: float) -> tuple[Rehearsed, Row]:
    """Fly a rehearsal in virtual time; its record, and how it ended as `landing_of` has it.

    Args:
        strayed: an aircraft farther from the middle of its pad than this is lost [m].
    """
    silence_log()
    reasons: list[str] = []

    def watch(_: object, status: ControlStatus | None) -> None:
        if status is not None and status.phase.value == "releasing":
            reasons.append(status.reason)

    async def fly() -> tuple[Rehearsed, bool]:
        rehearsal = prepare(watch)
        record = await rehearsal.fly()
        return record, rehearsal.world.truth.on_ground

    record, stands = run_virtually(fly(), 0.0)
    farthest = max((math.hypot(*moment.position[:2]) for moment in record.moments), default=0.0)
    return record, landing_of(record, "".join(reasons[:1]), stands=stands, is_lost=farthest > strayed)


def landing_of(record: Rehearsed, reason: str, *, stands: bool, is_lost: bool) -> Row:
    """How a flight that should land ended, by the physics: ending, why, `touch_cm` and `seconds`.

    Args:
        reason: of its first release; it only explains.
    """
    last = record.landing if record.landing is not None else (record.moments[-1] if record.moments else None)
    touch = math.nan if last is None else math.hypot(*last.position[:2])
    is_there = stands and last is not None and touch < ON_TARGET and last.position[2] < STANDS
    is_lost |= bool(record.crashed)
    finished = is_there and record.motors_stand and record.landing is not None and not is_lost
    return {
        "ending": Ending.FINISHED if finished else Ending.LOST if is_lost else Ending.RELEASED,
        "why": "" if finished else record.crashed or reason or record.outcome or "it never began",
        "touch_cm": round(100 * touch, 1) if math.isfinite(touch) else None,
        "seconds": round(record.moments[-1].at, 1) if record.moments else 0.0,
    }


DEMONSTRATIONS: Final = Campaign("demo", fly, dict, limit=600.0)


def summary(rows: list[Row]) -> Row:
    """Figures of flights under one radio."""
    too_long = {f"{name}_too_long": sum(row.get(name, 0.0) > most for row in rows) for name, most in HOLES.items()}
    return summed_up(rows, *HOLES) | too_long


def main(
    *,
    seeds: int = 200,
    first: First = 1,
    loss: tuple[float, ...] = (),
    jobs: Jobs = 2,
    results: Kept = None,
    as_json: AsJson = False,
) -> int:
    """Fly the demonstration with many seeds; half a minute of processor time a flight.

    Args:
        seeds: flights under each radio.
        loss: shares of radio packets lost each way, one campaign for each; the radio's own (1 %) where none is given.
    """
    shares = loss or (None,)
    asked = [
        {"seed": seed, "loss": share, "wind": "light", "fps": 15.0}
        for seed in range(first, first + seeds)
        for share in shares
    ]
    rows = DEMONSTRATIONS.rows(asked, jobs, results)
    found = [
        {"radio loss": "own" if share is None else f"{share:g}"}
        | summary([row for row in rows if row["loss"] == share])
        for share in shares
    ]
    return show(found, ("radio loss",), as_json=as_json)
