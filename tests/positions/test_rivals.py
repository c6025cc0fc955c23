"""Sources of poses for one target against each other: on motion that is written down, not flown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lab.control.corerig import stamp
from mkdaemon.config.positions import PositionSource
from mkdaemon.frames import quaternion_from_rotation, rotation_from_euler
from mkdaemon.positions.positioneye import PositionEye
from mkdaemon.telemetry.position import PositionReport
from mkdaemon.telemetry.vision import EyeState, PoseRefused, VisionPose
from tests.positions.test_motionjudge import FLIP, swaying

STEP = 0.01
"""Between two reports of a source [s]."""
RESTS, SWAYS = 0.0, 0.5
"""Share of the motion of `swaying`: none, and less than what a judge needs to decide by itself."""
SLOWLY = 2.0
"""Its pace [rad/s]."""


def right(place, rotation, t):
    return place, rotation


def off(place, rotation, t):
    return place + np.array([0.0, 0.2, 0.0]), rotation


def mirrored(place, rotation, t):
    return FLIP @ place, rotation


def silent_from(start, shown):
    return lambda place, rotation, t: None if t >= start else shown(place, rotation, t)


def from_then_on(start, shown):
    return lambda place, rotation, t: shown(place, rotation, t) if t >= start else (place, rotation)


class Flown:
    """Sources of one target that see a swaying aircraft, each as its `shown` distorts it."""

    def __init__(self, *shown, **fields):
        self.shown = dict(zip("abc", shown, strict=False))
        self.eyes = {name: PositionEye(PositionSource(name=name, **{"target": "map"} | fields)) for name in self.shown}
        for eye in self.eyes.values():
            eye.compare_with(self.eyes.values())
        self.used = {name: [] for name in self.shown}
        self.refused = {name: set() for name in self.shown}
        self.at, self.epoch = 0.0, 1

    def fly(self, seconds, share):
        for _ in range(round(seconds / STEP)):
            self.at += STEP
            (x, y), (ax, ay) = swaying(self.at, share, SLOWLY)
            place, rotation = np.array([x, y, 1.5]), rotation_from_euler(-ay, ax, 0.0)
            for name, eye in self.eyes.items():
                eye.attitude_received(self.at, ax, -ay)
                seen = self.shown[name](place, rotation, self.at)
                if seen is not None:
                    self.report(name, eye, *seen)
        return self

    def report(self, name, eye, place, rotation):
        quaternion = quaternion_from_rotation(rotation)
        # The noise keeps one that rests from repeating itself.
        position = tuple((place + 1e-6 * math.sin(1e4 * self.at)).tolist())
        fields = {"epoch": self.epoch, "sequence": round(self.at / STEP), "age": 0.0}
        report = PositionReport(**fields, position=position, quaternion=quaternion)
        for _, value in eye.take(report, self.at, self.at, stamp(self.at), is_flown=True):
            if isinstance(value, VisionPose):
                self.used[name].append(self.at)
            elif isinstance(value, PoseRefused):
                self.refused[name].add(value.refusal.value)

    def last_used(self, name):
        return self.at - self.used[name][-1] < 0.1

    def state(self, name):
        stats = self.eyes[name].stats(self.at, stamp(self.at))
        return stats.state, stats.reason


def test_two_that_agree_are_both_used():
    flown = Flown(right, right).fly(6.0, SWAYS)
    assert not flown.refused["a"] | flown.refused["b"]
    assert flown.state("a") == flown.state("b") == (EyeState.OK, "")


def test_of_two_that_show_different_places_neither_is_used_until_the_motion_of_the_aircraft_decides():
    flown = Flown(right, off).fly(3.0, RESTS)
    assert flown.refused == {"a": {"disputed"}, "b": {"disputed"}}
    assert not flown.last_used("a")
    assert not flown.last_used("b")
    state, reason = flown.state("b")
    assert state is EyeState.DISPUTED
    assert reason.startswith("a shows the aircraft 0.20 m from there, and nothing shows yet which is wrong")


def test_a_disputed_source_that_is_refused_for_another_reason_says_that_one():
    flown = Flown(right, off).fly(2.0, RESTS)
    flown.shown["b"] = lambda place, rotation, t: (place + np.array([2.0, 0.0, 0.0]), rotation)
    flown.fly(1.0, RESTS)
    assert flown.state("b") == (EyeState.CONTRADICTED, "they jumped; another body's pose, or another frame")
    assert flown.last_used("a")


@pytest.mark.parametrize("wrong", ["a", "b"])
def test_the_one_that_does_not_move_as_the_boards_do_is_named_and_the_other_flown_by(wrong):
    other = {"a": "b", "b": "a"}[wrong]
    shown = {wrong: from_then_on(3.0, mirrored), other: right}
    flown = Flown(shown["a"], shown["b"]).fly(3.0, RESTS).fly(4.0, SWAYS)
    state, reason = flown.state(wrong)
    assert state is EyeState.CONTRADICTED
    assert "another source shows another place, and the motion that the boards report" in reason
    assert "motion" in flown.refused[wrong]
    assert max(flown.used[wrong]) < 5.0
    assert flown.last_used(other)
    assert "motion" not in flown.refused[other]


def test_a_dispute_is_over_one_second_after_both_show_one_place_again():
    def off_for_a_moment(place, rotation, t):
        aside = 0.08 * math.sin(math.pi * t / 4.0) if t < 4.0 else 0.0  # above the limit of 5.8 cm until 2.97 s
        return place + np.array([0.0, aside, 0.0]), rotation

    flown = Flown(right, off_for_a_moment).fly(3.8, RESTS)
    assert not flown.last_used("a")
    flown.fly(0.5, RESTS)
    assert flown.last_used("a")


def test_of_three_the_two_that_agree_are_used():
    flown = Flown(right, off, right).fly(3.0, RESTS)
    assert flown.state("b")[0] is EyeState.DISPUTED
    assert flown.last_used("a")
    assert flown.last_used("c")
    assert not flown.last_used("b")


def test_a_single_outlier_of_the_right_one_decides_nothing():
    def outlier(place, rotation, t):
        return place + np.array([0.0, 0.3 if 1.0 < t < 1.015 else 0.0, 0.0]), rotation

    flown = Flown(outlier, off).fly(4.0, RESTS)
    assert "off_course" in flown.refused["a"]
    assert flown.state("a")[0] is flown.state("b")[0] is EyeState.DISPUTED


def test_of_three_a_jumped_one_is_no_vote_for_both_of_two_that_differ():
    def far(place, rotation, t):
        return place + np.array([0.0, -0.5, 0.0]), rotation

    flown = Flown(right, off, from_then_on(1.0, far)).fly(8.0, RESTS)
    assert not flown.last_used("a")
    assert not flown.last_used("b")


def test_a_source_that_is_later_than_the_other_is_compared_as_well():
    flown = Flown(right, off)
    for eye in flown.eyes.values():
        eye.cfg = eye.cfg.model_copy(update={"max_age": 0.5})
    queue, take = [], flown.report
    flown.report = lambda name, eye, *seen: (
        queue.append((name, eye, seen, flown.at)) if name == "a" else take(name, eye, *seen)
    )
    for _ in range(300):
        flown.fly(STEP, RESTS)
        while queue and queue[0][3] <= flown.at - 0.12:
            name, eye, seen, at = queue.pop(0)
            now, flown.at = flown.at, at
            take(name, eye, *seen)
            flown.at = now
    assert not flown.last_used("b")
    assert flown.state("b")[0] is EyeState.DISPUTED


def test_a_sender_that_starts_again_is_compared_anew():
    flown = Flown(from_then_on(3.0, mirrored), right).fly(3.0, RESTS).fly(4.0, SWAYS)
    assert flown.state("a")[0] is EyeState.CONTRADICTED
    flown.shown["a"], flown.epoch = right, 2
    flown.fly(2.0, SWAYS)
    assert flown.state("a") == (EyeState.OK, "")


def test_a_negative_variance_raises_nothing():
    eye = Flown(right).eyes["a"]
    covariance = tuple((-1.0 * np.eye(6)).ravel().tolist())
    report = PositionReport(
        epoch=1, sequence=1, age=0.0, position=(0, 0, 1), quaternion=(1, 0, 0, 0), covariance=covariance
    )
    assert eye.take(report, 1.0, 1.0, stamp(1.0), is_flown=False)


def test_one_that_has_jumped_disputes_nothing_until_it_has_agreed_for_a_second():
    flown = Flown(right, from_then_on(1.0, off)).fly(8.0, RESTS)  # what jumped is taken again after 5 s
    assert flown.refused == {"a": set(), "b": {"off_course", "disputed"}}
    assert flown.state("b")[0] is EyeState.DISPUTED
    flown.shown["b"] = lambda place, rotation, t: (
        place + np.array([0.0, max(0.0, 0.2 - 0.1 * (t - 8.0)), 0.0]),
        rotation,
    )
    flown.fly(4.0, RESTS)
    assert flown.state("b")[0] is EyeState.OK
    assert flown.last_used("b")


@pytest.mark.parametrize(
    ("other", "fields"),
    [
        (silent_from(2.0, off), {}),
        (off, {"frame_sd": 0.05}),
        (off, {"trusted_for": ()}),
    ],
    ids=["silent", "the frames are no better known", "both are references"],
)
def test_what_shows_nothing_disputes_nothing(other, fields):
    flown = Flown(right, other, **fields).fly(4.0, RESTS)
    assert flown.last_used("a")


def test_sources_of_different_targets_are_not_compared():
    flown = Flown(right, off)
    elsewhere = flown.eyes["b"] = PositionEye(PositionSource(name="b", target="room"))
    for eye in flown.eyes.values():
        eye.compare_with(flown.eyes.values())
    flown.fly(2.0, RESTS)
    assert flown.last_used("a")
    assert elsewhere.stats(flown.at, stamp(flown.at)).state is EyeState.OK
