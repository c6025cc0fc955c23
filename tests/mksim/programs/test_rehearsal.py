"""The demonstration in virtual time: flights seen by the real eyes over the real link; what is made of them."""

from __future__ import annotations

import asyncio
import math
from collections import Counter

import pytest

from lab.rigs.waiting import running
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest
from mkdaemon.telemetry.setpoint import PathSetpoint
from mkdaemon.telemetry.vision import PoseRefused, VisionStats
from mkdaemon.virtualtime import run_virtually
from mksim.programs.flightrecord import Moment, Rehearsed
from mksim.programs.rehearsal import (
    ROOM_FLIGHT,
    FlightPart,
    Rehearsal,
    room_demonstration,
    simulated_aircraft,
    take_off,
)
from mksim.scene.camera import landing_world
from mksim.simulation import Simulation


def test_a_flight_lands_on_the_pad_that_its_take_off_names_on_the_other_side_of_the_room():
    parts = (ROOM_FLIGHT[0], ROOM_FLIGHT[-1])

    async def fly():
        rehearsal = room_demonstration(simulated_aircraft(1, "indoor", 8.0), lambda moment, status: None, parts=parts)
        return await rehearsal.fly(), rehearsal.bus.values

    record, published = run_virtually(fly())
    began = next(moment for moment in record.moments if moment.part == "take-off")
    assert began.position == pytest.approx((-6.0, 0.0, 0.1), abs=0.02)
    assert record.outcome == "landed on pad-b"
    assert record.has_landed
    assert record.touch_error < 0.15
    assert record.posed > 0.95 * record.images
    assert published["vision/down/pose"].target in ("room", "pad-a", "pad-b")
    assert {target.name for target in published["vision/down/setup"].targets} == {"room", "pad-a", "pad-b"}


PATH = PathUploadRequest(
    points=tuple(
        PathPoint(position=place, speed=0.4 if number else None)
        for number, place in enumerate(((0.3, 0.0, 2.0), (0.0, 0.3, 2.0), (-0.3, 0.0, 2.0), (0.0, -0.3, 2.0)))
    )
)
TOO_FAST = {"points": [{"position": [0.0, 0.0, 2.0]}, {"position": [3.0, 0.0, 2.0], "time": 2.0}]}


def test_the_whole_daemon_checks_a_path_flies_it_and_shows_it():
    parts = (
        FlightPart("stale", PathSetpoint, {"path": "of the daemon before"}, 0.3),
        take_off(),
        FlightPart("path", PathSetpoint, {"run": 1}, path=PATH),
    )
    shown, refused = [], []

    def follow(suffix, value):
        if suffix == "control/path":
            shown.append(value)
        elif suffix == "event/command" and value.token is not None:
            refused.append((value.key, value.token))

    async def fly():
        config = simulated_aircraft(1, "indoor", 6.0)
        rehearsal = Rehearsal(config, Simulation(config, landing_world(config)), lambda moment, status: None, parts)
        rehearsal.bus.followers.append(follow)
        too_fast = await rehearsal.bus.ask("do/path_upload", **TOO_FAST)
        return await rehearsal.fly(), too_fast, rehearsal.bus.values

    record, too_fast, published = run_virtually(fly())
    assert (too_fast.status, too_fast.token) == ("denied", "path_refused")
    assert "piece 1 of 1" in too_fast.reason and "Slow the path down by" in too_fast.fix
    assert refused[:2] == [("do/path_upload", "path_refused"), ("setpoint/path", "no_path")]
    assert {token for key, token in refused if key == "setpoint/path"} == {"no_path"}
    assert shown[0].stage == "flies to the path"
    assert shown[-1].stage == "at the end of the path"
    assert (shown[-1].progress, shown[-1].left, shown[-1].target) == (1.0, 0.0, "pad")
    assert shown[0].points[0] == (0.3, 0.0, 2.0) and shown[0].points[-1] == (0.0, -0.3, 2.0)
    begins, ends = (next(value.stamp.monotonic for value in shown if test(value)) for test in (is_moving, is_at_end))
    away = [
        math.dist(moment.position[:2], moment.goal[:2])
        for moment in record.moments
        if moment.goal is not None and begins <= moment.at <= ends
    ]
    assert len(away) > 50
    assert math.sqrt(sum(each * each for each in away) / len(away)) < 0.1
    assert published["control/status"].manoeuvre in (None, "path")


def is_moving(value):
    return value.rate > 0.0


def is_at_end(value):
    return value.progress == 1.0


def moments(part, begin, places, goal=(0.0, 0.0, 2.0)):
    """A part of a flight, twenty moments a second."""
    return [Moment(begin + 0.05 * k, place, (0.0, 0.0, 0.0), goal, None, part) for k, place in enumerate(places)]


def flight(end=(0.05, 0.0, 0.1), outcome="landed on pad", motors_stand=True):
    """A flight that holds 10 cm beside its goal, steps by 1 m and lands."""
    held = moments("hold", 10.0, [(0.1, 0.0, 2.0)] * 100)
    step = moments("step", 20.0, [(min(0.05 * k - 0.5, 0.55), 0.0, 2.0) for k in range(60)])
    land = moments("land", 30.0, [end] * 20, goal=None)
    return Rehearsed(
        moments=held + step + land,
        parts={"hold": 10.0, "step": 20.0, "land": 30.0},
        outcome=outcome,
        motors_stand=motors_stand,
    )


def test_the_figures_are_those_of_the_true_flight():
    figures = flight().figures()
    assert figures["hold_rms_cm"] == figures["hold_max_cm"] == pytest.approx(10.0)
    assert figures["step_t90_s"] == pytest.approx(0.9, abs=0.06)
    assert figures["step_overshoot_percent"] == pytest.approx(5.0)
    assert figures["touch_cm"] == pytest.approx(5.0)
    assert figures["landed"] is True


@pytest.mark.parametrize(
    "flown",
    [
        flight(end=(0.5, 0.0, 0.1)),
        flight(end=(0.0, 0.0, 1.0)),
        flight(outcome="no image of pad for 3.0 s"),
        flight(motors_stand=False),
        Rehearsed(),
    ],
)
def test_only_an_aircraft_that_stands_on_its_target_with_motors_that_stand_has_landed(flown):
    assert not flown.has_landed


def looked(calibrated, seconds=6.0):
    """All values of a flight that stands on its pad, seen by eyes that take their lens for another one."""
    values = []

    async def look():
        config = simulated_aircraft(1, "none", 5.0)
        rehearsal = Rehearsal(config, Simulation(config), lambda moment, status: None, calibrated=calibrated)
        rehearsal.watch(lambda suffix, value: values.append(value))
        async with running(rehearsal.fly()):
            await asyncio.sleep(seconds)

    run_virtually(look())
    return values


def of(kind, values):
    return [value for value in values if isinstance(value, kind)]


def test_refusals_are_counted_and_published_by_image():
    values = looked(lambda lens: lens.model_copy(update={"fx": 0.7 * lens.fx}))
    refused, stats = of(PoseRefused, values), of(VisionStats, values)[-1]
    counted = Counter(one.refusal.value for one in refused if one.sequence <= stats.processed)
    assert counted == stats.refused != {}
    assert stats.posed < 1.0
