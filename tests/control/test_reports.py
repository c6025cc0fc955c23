"""What the flight core says of itself, and how often."""

from __future__ import annotations

import pytest

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import PublishError, PublishEstimate, PublishStatus, ReportFailsafe, ReportMode, Warn
from mkdaemon.control.authority import Authority
from mkdaemon.control.estimator.values import ViewFault
from mkdaemon.control.output import StickOutput
from mkdaemon.control.pilots_hands import CAPPED
from mkdaemon.control.reports import Reports
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.telemetry.control import ErrorValue, EstimateValue, Phase, ReleaseOutcome
from mkdaemon.telemetry.refusals import Token, refuse
from tests.control.admission.situations import eyes, heights
from tests.control.events import pose

CFG = ControlConfig()


def believed(**fields):
    return EstimateValue.model_construct(**{"stick_filter": 0.078, "stick_gain": 1.0, **fields})


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"stick_filter": 0.004}, "the stick filter is 4 ms, and not 78 ms"),
        ({"stick_gain": 1.49}, "1.49 times that of its parameter set, and not 1.00 times"),
    ],
)
def test_an_answer_to_the_sticks_that_is_not_the_models_is_told_once_with_both_numbers(told, fields, words):
    for value in (believed(), believed(stick_gain=1.04), believed(**fields), believed(**fields)):
        told.reports.estimate(value, None)
    [warning] = told.words()
    assert words in warning
    assert told.reports.take() == []


def test_heights_that_the_barometer_contradicts_are_told_once_with_their_scale(told):
    for odds in (0.0, 1.9, 2.1, 5.0, 5.0):
        told.facts.eye_reported(eyes(selfcal=(heights(20.0, sd=4.0, covered=2.5, odds=odds),)))
        told.reports.eyes_reported()
    [warning] = told.words()
    assert "the barometer 2.00 +- 0.10 m" in warning
    assert "an error of +20 %" in warning


class Told:
    """Reports of a flight core that flies nothing."""

    def __init__(self):
        self.facts = VehicleMemory()
        self.authority = Authority(CFG, first_epoch=1)
        self.output = StickOutput(CFG, self.facts)
        self.reports = Reports(self.authority, self.output, self.facts)

    def words(self):
        """Warnings since the last call."""
        return [action.text for action in self.reports.take() if isinstance(action, Warn)]

    def status(self, now, battery=None):
        self.reports.status("v2", battery, 0.25, now)
        return [action for action in self.reports.take() if isinstance(action, PublishStatus)]


@pytest.fixture
def told():
    return Told()


REFUSED = refuse(Token.NOT_LEASED)


def test_refused_poses_are_all_counted_and_named_once_a_second(told):
    counts = []
    for now in (0.0, 0.5, 1.0, 1.99):
        told.reports.pose_refused(pose(now), ViewFault.NOT_FINITE, now)
        counts.append(len(told.words()))
    assert counts == [1, 0, 1, 0]
    [status] = told.status(2.0)
    assert status.poses_refused == 4


def test_an_estimate_and_how_far_it_is_from_the_goal_are_published_where_there_are_any(told):
    error = ErrorValue.model_construct(manoeuvre="hold")
    told.reports.estimate(None, None)
    assert told.reports.take() == []
    told.reports.estimate(believed(), None)
    assert [type(action) for action in told.reports.take()] == [PublishEstimate]
    told.reports.estimate(believed(), error)
    assert [type(action) for action in told.reports.take()] == [PublishEstimate, PublishError]


def test_a_gain_a_tenth_away_from_the_one_told_last_is_told_and_its_way_back_too(told):
    words = []
    for gain in (1.0, 1.09, 1.125, 1.2, 1.25, 1.0):
        told.reports.estimate(believed(stick_gain=gain), None)
        words.append([text.split(" times")[0].rsplit(" ", 1)[1] for text in told.words()])
    assert words == [[], [], ["1.12"], [], ["1.25"], ["1.00"]]


def test_a_filter_and_a_gain_that_are_new_at_once_are_told_both(told):
    told.reports.estimate(believed(), None)
    told.reports.estimate(believed(stick_filter=0.004, stick_gain=1.5), None)
    assert len(told.words()) == 2
    told.reports.estimate(believed(stick_filter=0.078, stick_gain=1.5), None)
    assert told.words() == ["the stick filter is 78 ms, and not 4 ms: the aircraft answers its sticks so"]


def test_status_is_published_once_a_second_and_at_once_when_it_changes(told):
    assert [len(told.status(now)) for now in (0.0, 0.5, 0.99, 1.0, 1.5)] == [1, 0, 0, 1, 0]
    told.authority.reason = "something else"
    [status] = told.status(1.6)
    assert status.reason == "something else"
    assert [len(told.status(now)) for now in (2.5, 2.6)] == [0, 1]


def test_status_says_what_is_known_of_frames_poses_and_layout(told):
    told.output.handed_over, told.output.sent, told.output.confirmed = 5, 3, 2
    [status] = told.status(0.0)
    frames = (status.frames_handed_over, status.frames_sent, status.frames_dropped, status.frames_confirmed)
    assert frames == (5, 3, 2, 2)
    assert (status.pose_age, status.external_control, status.lease) == (0.25, "v2", None)
    assert (status.manoeuvre, status.stage, status.is_done, status.outcome) == (None, "", False, None)
    assert (status.pilots_throttle, status.hands) == (None, "flies")


def test_a_low_battery_is_told_when_it_begins_to_be_low(told):
    low = refuse(Token.BATTERY_LOW, voltage=12.0)
    words = []
    for k, battery in enumerate((None, low, low, None, low)):
        told.reports.status("v2", battery, 0.25, 0.1 * k)
        words.append(told.words())
    assert words == [[], ["the battery is low: 12.0 V. Land and change the battery."], [], [], words[1]]


def test_a_throttle_that_caps_ours_is_told_when_it_begins_and_shown_in_flight_only(told):
    told.output.lid.pilots_throttle = -14.0
    assert told.status(0.0)[0].pilots_throttle is None
    told.authority.phase = Phase.FLYING
    told.reports.status("v2", None, 0.25, 0.1)
    actions = told.reports.take()
    [warning] = [action for action in actions if isinstance(action, Warn)]
    assert "(-14) caps ours" in warning.text
    [status] = [action for action in actions if isinstance(action, PublishStatus)]
    assert (status.pilots_throttle, status.hands) == (-14.0, CAPPED)
    told.reports.status("v2", None, 0.25, 0.2)
    assert told.words() == []
    told.output.lid.pilots_throttle = None
    assert told.status(0.3)[0].pilots_throttle is None, "told at once, too"
    told.output.lid.pilots_throttle = -14.0
    told.reports.status("v2", None, 0.25, 0.4)
    assert len(told.words()) == 1


@pytest.mark.parametrize(
    ("outcome", "is_confirmed"),
    [
        (None, None),
        (ReleaseOutcome.CONFIRMED, True),
        (ReleaseOutcome.UNCONFIRMED, False),
        (ReleaseOutcome.NOT_SENT, False),
        (ReleaseOutcome.NOT_OBSERVABLE, None),
    ],
)
def test_a_release_nobody_asked_for_is_a_failsafe_with_its_outcome(told, outcome, is_confirmed):
    told.reports.released("silence", outcome)
    assert told.reports.take() == [ReportFailsafe("release", "silence", is_confirmed)]


@pytest.mark.parametrize(("phase", "failsafe"), [(Phase.STALE, "neutral"), (Phase.LANDING, "land"), (Phase.FLYING, "")])
def test_a_phase_is_told_when_it_changes_and_as_a_failsafe_where_it_is_one(told, phase, failsafe):
    told.authority.phase, told.authority.reason = phase, "because"
    told.reports.phase_changed()
    told.reports.phase_changed()
    expected = [ReportMode(Phase.FREE, phase, "because")]
    assert told.reports.take() == expected + ([ReportFailsafe(failsafe, "because")] if failsafe else [])


def test_another_phase_tells_the_models_numbers_anew(told):
    told.reports.estimate(believed(), None)
    told.authority.phase = Phase.FLYING
    told.reports.phase_changed()
    told.reports.estimate(believed(stick_gain=1.5), None)
    assert told.words() == [], "another flight, which has its own first value"
