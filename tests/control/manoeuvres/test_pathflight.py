"""Flights along a path: its clock, and the whole core that flies by it, in virtual time."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.control.camera import CameraModel
from lab.control.flights import Flight
from mkdaemon.control.actions import PublishError, PublishPath, PublishStatus, ReleaseAircraft
from mkdaemon.control.events import AbortAsked, PathUploaded
from mkdaemon.control.manoeuvres.by_target import SEARCHES
from mkdaemon.control.manoeuvres.pathflight import APPROACHES, ENDED, FOLLOWS, PAUSES, PathClock, rate_behind
from mkdaemon.control.path.curve import PathCurve
from mkdaemon.control.regulator.horizontal import PREVIEW, STEP
from mkdaemon.telemetry.command import AbortRequest
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.path import PathPoint, PathUploadRequest
from mkdaemon.telemetry.setpoint import HoldSetpoint, PathSetpoint
from mksim.config import WindClass
from tests.control.coreflights import Told
from tests.control.events import Driver

CIRCLE = PathUploadRequest(
    points=tuple(
        PathPoint(position=(0.4 * math.cos(turn), 0.4 * math.sin(turn), 2.0), speed=0.4 if turn else None)
        for turn in np.linspace(0.0, math.tau, 13)
    )
)
LENGTH = PathCurve.of(CIRCLE).duration
BEGINS = 8.0
"""The path is asked for from then on; before, the aircraft holds its place [s]."""
AGAIN = BEGINS + 5.5 + LENGTH
"""The path is at its end, and another run is asked for [s]."""
PAUSED, GOES_ON, GONE, ABORTED = AGAIN + 4.0, AGAIN + 7.0, AGAIN + 7.5, AGAIN + 13.8
"""In the other run: a pause, its end, a target that is out of sight for 1.8 s, and an abort [s]."""
CHANGES = ((AGAIN, {"run": 1}), (PAUSED, {"paused": True}), (GOES_ON, {"paused": False}))


class PathRig(Told):
    """Holds, flies along the circle, and begins it again: with a pause, a loss of sight and an abort.

    Attributes:
        away: distance of the true place from that on the path, at each stick frame of the first run [m].
        stages: each stage of the path in its order, with its time [s].
    """

    def __init__(self):
        camera = CameraModel(gone=((GONE, GONE + 1.8),), rate=15.0)
        super().__init__(Flight(seed=4, wind=WindClass.INDOOR, seconds=ABORTED + 0.6, camera=camera))
        self.away, self.stages = [], []
        assert self.core.feed(PathUploaded(CIRCLE), 0.0).refusal is None
        self.id = self.core.path_stored.id
        self._looked, self._is_aborted = 0, False

    def _setpoint(self, goal, at):
        stream = {"epoch": self._epoch, "sequence": self._sequence, "ttl": 0.3}
        if at < BEGINS:
            return HoldSetpoint(**stream)
        fields = {}
        for since, change in CHANGES:
            fields |= change if at >= since else {}
        return PathSetpoint(**stream, path=self.id, **fields)

    def _control(self, at):
        if at >= ABORTED and not self._is_aborted:
            self._is_aborted = True
            self.core.feed(AbortAsked(AbortRequest(reason="the operator saw something")), at)
        super()._control(at)
        for when, action in self.actions[self._looked :]:
            if isinstance(action, PublishStatus) and action.manoeuvre == "path":
                if not self.stages or self.stages[-1][1] != action.stage:
                    self.stages.append((when, action.stage))
            elif isinstance(action, PublishError) and at < AGAIN and self.stages[-1:] and self.stages[-1][1] == FOLLOWS:
                self.away.append(math.dist(self._world.truth.position_enu[:2], action.value.goal[:2]))
        self._looked = len(self.actions)


@pytest.fixture(scope="module")
def flown():
    """The flight, and its record; nobody changes either."""
    rig = PathRig()
    record = rig.fly()
    assert record.lost == ""
    return rig, record


def test_a_path_is_followed_to_its_end_and_shown(flown):
    rig, record = flown
    assert [stage for at, stage in rig.stages if at < AGAIN] == [APPROACHES, FOLLOWS, ENDED]
    assert float(np.sqrt(np.mean(np.square(rig.away)))) < 0.08
    end = record.positions[next(k for k, at in enumerate(record.times) if at > AGAIN)]
    assert end == pytest.approx([0.4, 0.0, 2.0], abs=0.15)
    assert rig.of(PublishStatus, end=AGAIN)[-1][1].is_done
    shown = [action.value for _, action in rig.of(PublishPath, end=AGAIN)]
    assert {(value.id, value.target, value.is_paused) for value in shown} == {(rig.id, "pad", False)}
    assert all(len(value.points) == 100 and value.points[0] == (0.4, 0.0, 2.0) for value in shown)
    progress = [value.progress for value in shown]
    assert progress == sorted(progress)
    assert (progress[0], progress[-1], shown[-1].left) == (0.0, 1.0, 0.0)
    assert {value.stage for value in shown} == {APPROACHES, FOLLOWS, ENDED}
    assert shown[len(shown) // 2].left == pytest.approx(LENGTH * (1.0 - shown[len(shown) // 2].progress))


def test_another_run_begins_at_the_first_point_again_and_an_abort_holds(flown):
    rig, _ = flown
    run = [stage for at, stage in rig.stages if at >= AGAIN]
    assert run == [APPROACHES, FOLLOWS, PAUSES, FOLLOWS, SEARCHES, APPROACHES, FOLLOWS]
    assert rig.core.phase is Phase.ABORTED
    assert rig.of(PublishStatus)[-1][1].manoeuvre == "hold"
    last = rig.of(PublishPath)[-1]
    assert last[0] < ABORTED + 0.1 and 0.0 < last[1].value.progress < 0.9


def test_a_pause_stops_smoothly_and_the_flight_goes_on_from_there(flown):
    rig, _ = flown
    paused = [(at, action.value) for at, action in rig.of(PublishPath) if action.value.is_paused]
    standing = {round(value.progress, 6) for at, value in paused if at > PAUSED + 2.0}
    assert len(standing) == 1 and 0.1 < next(iter(standing)) < 0.9
    assert {value.rate for at, value in paused if at > PAUSED + 2.0} == {0.0}
    errors = rig.of(PublishError, PAUSED - 0.5, PAUSED + 2.0)
    goals = [(at, action.value.goal) for at, action in errors]
    steps = [math.dist(before, after) / (until - since) for (since, before), (until, after) in pairwise(goals)]
    assert max(steps) < 0.5 and steps[-1] == 0.0
    # What should be braked is braked in time: never harder than the reference of any other flight.
    assert max(abs(one - other) for one, other in pairwise(steps)) < 0.05


def test_a_target_out_of_sight_stops_the_clock_and_after_the_search_the_flight_goes_on(flown):
    rig, _ = flown
    assert not rig.of(ReleaseAircraft)
    progress = [action.value.progress for _, action in rig.of(PublishPath, AGAIN + 1.0)]
    assert progress == sorted(progress), "it never begins again"


def test_an_id_that_this_daemon_has_not_is_refused_with_what_to_do():
    """As after a restart, with the id of a path that the daemon before had."""
    drive = Driver()
    drive.take()
    refusal = drive.send(PathSetpoint, path="0123456789abcdef")
    assert refusal is not None
    assert refusal.token == "no_path"
    assert "the daemon has restarted since it was uploaded" in refusal.reason
    assert "Upload the path again" in refusal.fix


def test_a_path_that_cannot_be_flown_is_refused_by_the_core_and_not_kept():
    drive = Driver()
    points = (PathPoint(position=(0.0, 0.0, 2.0)), PathPoint(position=(4.0, 0.0, 2.0), time=2.0))
    refusal = drive.core.feed(PathUploaded(PathUploadRequest(points=points)), 0.0).refusal
    assert refusal is not None and refusal.token == "path_refused"
    assert drive.core.path_stored is None
    assert drive.core.situation(0.0).paths == frozenset()


@pytest.mark.parametrize(("away", "rate"), [(0.0, 1.0), (0.25, 1.0), (0.425, 0.5), (0.6, 0.0), (3.0, 0.0)])
def test_the_clock_slows_down_for_an_aircraft_that_falls_behind(away, rate):
    assert rate_behind(away) == pytest.approx(rate)


ACCELERATION = 0.9
BOUND = 1.02 * ACCELERATION


@settings(max_examples=8)
@given(st.lists(st.tuples(st.sampled_from([0.0, 0.3, 1.0, 1.0]), st.floats(0.005, 0.05)), min_size=5, max_size=60))
def test_the_clock_never_jumps_never_runs_back_and_brakes_gently(asked):
    curve = PathCurve.of(CIRCLE)
    clock = PathClock(curve, ACCELERATION)
    for _ in range(100):
        clock.move(1.0, 0.02)
    for wanted, step in asked:
        at, rate = clock.at, clock.rate
        course = clock.move(wanted, step)
        assert 0.0 <= clock.rate <= 1.0
        assert at <= clock.at <= at + max(rate, clock.rate) * step + 1e-9
        speed = np.linalg.norm(curve.at(np.array([at])).velocity[0, :3])
        assert abs(clock.rate - rate) * speed <= BOUND * step
        place = curve.at(np.array([clock.at]))
        assert course.position == pytest.approx(place.position[0, :3])
        assert course.velocity == pytest.approx(place.velocity[0, :3] * clock.rate)


@settings(max_examples=8)
@given(st.floats(0.0, 1.0), st.sampled_from([0.0, 1.0]))
def test_what_is_seen_ahead_is_what_comes(share, wanted):
    """The jumps add up to the accelerations, and the gains to the velocities, that the clock then has.

    How fast the clock may change its rate depends on the speed, which is not foreseen: 0.13 m/s2 from rest.
    """
    clock = PathClock(PathCurve.of(CIRCLE), ACCELERATION)
    while clock.at < share * LENGTH:
        clock.move(1.0, STEP)
    seen = clock.move(wanted, STEP)
    then = [clock.move(wanted, STEP) for _ in range(10)]
    velocity = seen.velocity[:2] + np.cumsum(seen.gains, axis=0)
    acceleration = seen.acceleration[:2] + np.cumsum(seen.jumps, axis=0)
    assert seen.jumps.shape == seen.gains.shape == (PREVIEW, 2)
    for k, course in enumerate(then):
        assert velocity[k] == pytest.approx(course.velocity[:2], abs=0.02)
        assert acceleration[k] == pytest.approx(course.acceleration[:2], abs=0.15)


def test_at_the_end_the_clock_stands():
    curve = PathCurve.of(CIRCLE)
    clock = PathClock(curve, ACCELERATION)
    while not clock.has_ended:
        course = clock.move(1.0, STEP)
    assert clock.at == curve.duration
    course = clock.move(1.0, STEP)
    assert not course.velocity.any() and not course.acceleration.any() and not course.jumps.any()
    assert course.position == pytest.approx((0.4, 0.0, 2.0))
    clock.stop()
    assert clock.rate == 0.0
