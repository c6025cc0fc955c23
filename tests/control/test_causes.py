"""A target out of sight: what the aircraft does, and the causes as data, in the status and in the release."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from lab.control.camera import CameraModel
from lab.control.corerig import stamp
from lab.control.flights import Flight
from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.control.actions import PublishStatus, ReleaseAircraft, Warn
from mkdaemon.control.causes import ATTITUDE_OVERDUE, causes
from mkdaemon.control.events import SightRefused
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.telemetry.control import CauseKind
from mkdaemon.telemetry.vision import PoseRefusal, PoseRefused
from mksim.config import WindClass
from tests.control.coreflights import UntilReleased
from tests.values import made

GONE = 3.5
"""From then on no image gives a pose [s]."""


def refusal_at(at, refusal=PoseRefusal.OFF_COURSE, decode_age=0.0):
    return made(PoseRefused, stamp(at), camera="down", target="pad", refusal=refusal, decode_age=decode_age)


def test_refusals_since_the_last_pose_count_and_older_ones_do_not():
    facts = VehicleMemory()
    for at in (1.0, 8.5, 8.9, 9.5):
        facts.sight_refused(refusal_at(at))
    chain = causes(facts, pose_age=2.0, attitude_age=0.1, now=10.0)
    assert [(each.kind, each.count) for each in chain] == [(CauseKind.NO_POSE, None), (CauseKind.REFUSED_IN_VIEW, 3)]
    assert [each.text for each in chain] == ["no pose for 2.0 s", "tag in view, 3 poses refused off_course"]


def test_a_target_whose_tags_are_not_decoded_is_not_said_to_be_in_view():
    facts = VehicleMemory()
    facts.sight_refused(refusal_at(9.5, decode_age=4.0))
    assert causes(facts, pose_age=2.0, attitude_age=0.1, now=10.0)[1].kind is CauseKind.REFUSED


@pytest.mark.parametrize(
    ("age", "kind"),
    [
        (ATTITUDE_OVERDUE - 0.01, None),
        (ATTITUDE_OVERDUE + 0.01, CauseKind.NO_ATTITUDE),
        (None, CauseKind.NEVER_ATTITUDE),
    ],
)
def test_an_attitude_that_is_overdue_is_a_cause(age, kind):
    found = [each.kind for each in causes(VehicleMemory(), pose_age=1.0, attitude_age=age, now=10.0)]
    assert found == [CauseKind.NO_POSE, *([] if kind is None else [kind])]


class Refused(UntilReleased):
    """The target stays in the image, and every pose is refused."""

    def _control(self, at):
        if at >= GONE and round(at * 50) % 5 == 0:
            self.core.feed(SightRefused(refusal_at(at)), at)
        super()._control(at)


@pytest.fixture(scope="module")
def flown():
    camera = CameraModel(gone=((GONE, 99.0),))
    rig = Refused(replace(Flight(seed=4, wind=WindClass.INDOOR, seconds=8.0), camera=camera))
    rig.record = rig.fly()
    return rig


def test_it_searches_from_above_then_is_released_with_its_causes(flown):
    places = list(zip(flown.record.times, flown.record.positions, strict=True))
    before, after = next(place for at, place in places if at >= GONE), places[-1][1]
    assert after[2] > before[2] + 0.4
    # Without images only the model tells where it is, to 1.7 m after 3 s.
    assert math.hypot(*after[:2]) < max(flown.estimates[-1].position_sd[:2]), "it stays over the target"
    released, release = flown.first(ReleaseAircraft)
    assert released == pytest.approx(GONE + AutopilotConfig().exit_after, abs=0.3)
    assert release.reason.startswith("no image of pad for 3.0 s; tag in view, ")
    assert "poses refused off_course" in release.reason


def test_the_status_counts_down_to_the_release(flown):
    told = [(at, action) for at, action in flown.of(PublishStatus) if action.causes]
    assert told[0][0] == pytest.approx(GONE + 0.5, abs=0.2)
    left = [action.releases_in for _, action in told]
    assert left == sorted(left, reverse=True)
    assert left[-1] < 0.3
    assert max(b - a for (a, _), (b, _) in pairwise(told)) < 0.25
    assert ["NO POSE" in action.text for _, action in flown.of(Warn)].count(True) == 1


def test_a_flight_with_poses_is_not_in_trouble(flown):
    early = [action for _, action in flown.of(PublishStatus, end=GONE)]
    assert early
    assert not any(action.causes or action.trouble for action in early)
