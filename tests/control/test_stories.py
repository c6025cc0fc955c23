"""Whole flights told to the core as events, with an aircraft that is where the story says: no physics, no port."""

from __future__ import annotations

import pytest

from mkdaemon.config.autopilot import AutopilotConfig
from mkdaemon.config.control import ControlConfig
from mkdaemon.control.actions import (
    PublishError,
    PublishEstimate,
    PublishStatus,
    ReportFailsafe,
    ReportMode,
    SendSticks,
    Warn,
)
from mkdaemon.control.estimator.values import GAS_CENTRE
from mkdaemon.control.events import AbortAsked, FlightctrlReported, MotorsReported, PoseSeen, StateValue
from mkdaemon.control.flightwatch import LASTING
from mkdaemon.control.manoeuvres import land, take_off
from mkdaemon.control.manoeuvres.manoeuvre import level_at
from mkdaemon.control.sight import FORGOTTEN
from mkdaemon.telemetry.command import AbortRequest
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.setpoint import (
    HoldSetpoint,
    LandSetpoint,
    PositionSetpoint,
    SetpointFrame,
    StickSetpoint,
    TakeOffSetpoint,
    VelocitySetpoint,
)
from tests.control.admission.situations import battery
from tests.control.events import PERIOD, Driver, flight, pilot, pose

SOON = ControlConfig(autopilot=AutopilotConfig(takeoff_ready=0.2, entry_clean=0.5))
"""A configuration with which nobody waits for long."""


class Story(Driver):
    """A core, and images that show the aircraft at a height over the target, while it is in sight."""

    def __init__(self, height=None):
        super().__init__(SOON)
        self.height = height
        self.take()

    def see(self, height, target="pad"):
        """An image of now."""
        seen = pose(self.now).model_copy(update={"position_flu": (0.0, 0.0, -height), "target": target})
        self.tell(PoseSeen(seen))

    def streams(self, kind, seconds, **fields):
        """Setpoints of a kind at 50 Hz; returns the refusals."""
        refusals = set()
        for _ in range(round(seconds / PERIOD)):
            if self.height is not None and self.sequence % 2:
                self.see(self.height)
            refusal = self.send(kind, **fields)
            refusals.add(None if refusal is None else refusal.token)
            self.run(PERIOD)
        return refusals

    def sticks_neutral(self, seconds):
        return self.streams(StickSetpoint, seconds, pitch=0.0, roll=0.0, yaw=0.0, throttle=10.0)

    def streams_low(self, seconds):
        """Holds, and reports of a low battery ten times a second."""
        for _ in range(round(seconds / (5 * PERIOD))):
            self.tell(StateValue(battery(12.0, is_low=True)))
            self.streams(HoldSetpoint, 5 * PERIOD)

    def abort(self, reason="not here"):
        return self.tell(AbortAsked(AbortRequest(reason=reason))).refusal

    @property
    def status(self):
        return self.of(PublishStatus)[-1]

    @property
    def level(self):
        """Sticks of nothing but what carries the aircraft."""
        return level_at(self.core._sight.hover_gas)

    @property
    def changes(self):
        return [(mode.before.value, mode.after.value) for mode in self.of(ReportMode)]


def test_one_that_takes_off_where_no_target_was_ever_seen_flies_by_the_first_two_images():
    story = Story()
    story.tell(MotorsReported(True))
    story.streams(TakeOffSetpoint, 1.5, height=1.0)
    assert (story.core.phase, story.status.stage) == (Phase.FLYING, "throttle rises")
    assert not story.of(PublishEstimate), "nothing is known of it"
    story.see(0.20)
    story.streams(TakeOffSetpoint, PERIOD, height=1.0)
    assert story.status.stage == "throttle rises", "one image is none"
    story.see(0.21)
    story.streams(TakeOffSetpoint, PERIOD, height=1.0)
    assert (story.status.manoeuvre, story.status.stage) == ("takeoff", "climbs")
    estimate = story.of(PublishEstimate)[-1].value
    assert (estimate.target, estimate.position[2]) == ("pad", pytest.approx(0.21, abs=0.05))
    story.see(0.25, target="other")
    assert story.core._sight.target == "pad", "it is flown by"


def holding(height=2.0):
    story = Story(height)
    story.see(height)
    assert story.streams(HoldSetpoint, 2.2) == {None}
    assert story.core.phase is Phase.FLYING
    return story


def test_a_low_battery_lands_once_and_who_aborts_that_landing_flies_on():
    story = holding()
    story.streams_low(LASTING + 0.3)
    assert story.changes[-1] == ("flying", "landing")
    assert story.status.manoeuvre == "land"
    [failsafe] = story.of(ReportFailsafe)
    assert (failsafe.action, failsafe.released) == ("land", None)
    assert story.abort() is None
    story.streams_low(LASTING + 0.5)
    assert story.changes[-1] == ("landing", "aborted")
    assert (story.status.manoeuvre, story.status.reason) == ("hold", "aborted: not here")
    assert len(story.of(Warn)) == 1, "told once"
    assert not story.releases


def test_after_an_abort_the_place_is_held_whatever_is_streamed_until_the_lease_ends():
    story = holding()
    story.streams(LandSetpoint, 0.3)
    assert story.status.manoeuvre == "land"
    assert story.abort("a dog") is None
    assert story.abort("a dog again") is None, "it holds already"
    story.streams(LandSetpoint, 0.5)
    assert (story.core.phase, story.status.manoeuvre) == (Phase.ABORTED, "hold")
    assert story.status.reason == "aborted: a dog"
    assert len({error.value.goal for error in story.of(PublishError)[-10:]}) == 1
    story.run(story.core._cfg.lease.release_after + 0.1)
    assert [release.reason[:21] for release in story.releases] == ["no setpoint from alic"]


def test_with_nothing_flown_an_abort_is_refused_and_says_what_is_the_case():
    story = Story()
    refusal = story.abort()
    assert refusal.token == "nothing_flown"
    assert "alice holds the lease" in refusal.reason


def test_from_sticks_to_a_place_only_what_may_begin_begins():
    story = Story()
    assert story.sticks_neutral(1.5) == {None}
    assert story.core.phase is Phase.FLYING
    assert story.streams(HoldSetpoint, 0.1) == {"no_estimate"}
    story.height = 2.0
    story.see(2.0)
    assert story.streams(HoldSetpoint, 0.1) == {"not_ready"}, "images have not agreed for long enough"
    assert story.sticks_neutral(0.8) == {None}
    assert story.streams(HoldSetpoint, 0.1) == {None}
    assert story.status.manoeuvre == "hold"
    assert story.streams(LandSetpoint, 0.1) == {None}
    assert story.sticks_neutral(0.1) == {None}
    assert story.status.manoeuvre == "stick"
    assert story.streams(TakeOffSetpoint, 0.1, height=1.0) == {"not_on_ground"}


def test_clients_that_give_no_name_are_numbered():
    drive = Driver()
    names = [drive.request(holder="", force=True).holder for _ in range(3)]
    assert names == ["anonymous-1", "anonymous-2", "anonymous-3"]


@pytest.mark.parametrize(
    ("kind", "changes"), [("nothing", True), ("hold, on the ground", True), ("stick", True), ("hold", False)]
)
def test_another_target_is_followed_after_five_seconds_unless_the_first_is_flown_by(kind, changes):
    story = holding() if kind == "hold" else Story()
    if kind == "stick":
        story.sticks_neutral(1.5)
    story.see(2.0)
    story.height = None
    if kind == "hold, on the ground":
        story.streams(HoldSetpoint, 0.1)
    assert (story.core.phase is Phase.FLYING) is (kind in {"stick", "hold"})
    story.now += FORGOTTEN + 0.1
    story.see(2.0, target="other")
    assert story.core._sight.target == ("other" if changes else "pad")
    words = [warning.text for warning in story.tick() if isinstance(warning, Warn) and "followed" in warning.text]
    assert words == ["target other is followed now: pad was out of sight for too long"] * changes


def test_while_the_navictrl_does_not_hear_its_flightctrl_nobody_flies():
    drive = Driver()
    drive.fly()
    drive.tell(MotorsReported(True))
    drive.tell(FlightctrlReported(is_lost=True))
    assert drive.core.vehicle.is_fc_lost
    assert drive.core.vehicle.motors_running(drive.now) is None, "what is shown of it is old"
    drive.run(PERIOD)
    [release] = drive.releases
    assert release.reason.startswith("external control is not possible: the NaviCtrl does not hear its FlightCtrl")
    drive.tell(FlightctrlReported(is_lost=False))
    assert not drive.core.vehicle.is_fc_lost


BY_TARGET_IN_AIR = {
    HoldSetpoint: {},
    LandSetpoint: {},
    PositionSetpoint: {"position": (0.0, 0.0, 2.0), "frame": SetpointFrame.PAD},
    VelocitySetpoint: {"velocity": (0.0, 0.0, 0.5), "frame": SetpointFrame.PAD},
}
GROUNDED = {
    "motors off on the pad": (0.10, {"is_flying": False, "motors_running": False}),
    "motors off in a hand": (1.0, {"is_flying": False, "motors_running": False}),
    "motors at idle, the board says so": (1.0, {"is_flying": False}),
    "motors at idle, the board says that it flies": (0.12, {"is_flying": True}),
    "motors at idle, no board says anything": (0.12, None),
}


@pytest.mark.parametrize(
    ("kind", "case"),
    [*((HoldSetpoint, case) for case in GROUNDED), *((kind, [*GROUNDED][-1]) for kind in [*BY_TARGET_IN_AIR][1:])],
)
def test_no_flight_by_the_target_begins_with_an_aircraft_that_does_not_fly(kind, case):
    """The question that was not asked: does each beginning know whether the aircraft flies?

    Throttle wound up to its limit against a model that flies; when the pilot started the motors the aircraft went up
    at 6.9 m/s. That each kind asks it is a row of admission.
    """
    height, said = GROUNDED[case]
    story = Story(height)
    story.see(height)
    for _ in range(12):
        if said is not None:
            story.tell(MotorsReported(said.get("motors_running", True)))
            story.tell(StateValue(flight(**said)))
        assert story.streams(kind, 5 * PERIOD, **BY_TARGET_IN_AIR[kind]) == {None}, "it waits, it is not refused"
    assert story.core.phase is Phase.LEASED
    assert "waiting for an aircraft in the air" in story.status.reason
    assert not story.of(SendSticks)
    assert story.core._sight.estimator.hover_gas == pytest.approx(story.core._sight.hover_gas), "nothing is learnt"


def test_what_is_flown_by_hand_on_the_ground_is_not_handed_to_the_target():
    """On the pad at idle a hold would take off, and so would a landing."""
    story = Story(0.12)
    story.see(0.12)
    story.sticks_neutral(2.2)
    assert story.core.phase is Phase.FLYING
    for kind, fields in BY_TARGET_IN_AIR.items():
        assert story.streams(kind, 3 * PERIOD, **fields) == {"not_flying"}
    assert story.status.manoeuvre == "stick"


@pytest.mark.parametrize("kind", [HoldSetpoint, PositionSetpoint, VelocitySetpoint, LandSetpoint])
def test_a_take_off_becomes_nothing_else_on_the_ground_from_its_very_first_tick_on(kind):
    """A setpoint between the first tick of the flight and the second found an aircraft that might fly."""
    story = Story(0.12)
    story.see(0.12)
    story.tell(MotorsReported(True))
    while story.core.phase is not Phase.FLYING:
        story.run(PERIOD)
        assert story.send(TakeOffSetpoint, height=1.0) is None
        story.tick()
    assert story.streams(kind, 10 * PERIOD, **BY_TARGET_IN_AIR[kind]) <= {"not_flying", "no_estimate"}
    assert story.status.manoeuvre == "takeoff"
    assert max(frame.counts.throttle for frame in story.of(SendSticks)) == -100


def test_a_landing_that_touches_the_ground_becomes_no_hold_and_no_position():
    story = holding(0.5)
    story.height = 0.2
    for _ in range(150):
        story.streams(LandSetpoint, PERIOD)
        if story.status.stage == "commit":
            break
    for kind in (HoldSetpoint, PositionSetpoint, VelocitySetpoint):
        assert story.streams(kind, 2 * PERIOD, **BY_TARGET_IN_AIR[kind]) == {"not_flying"}
    assert story.status.manoeuvre == "land"


def test_a_low_battery_lands_no_aircraft_that_stands():
    """The landing would climb to its approach first."""
    story = Story(0.12)
    story.see(0.12)
    story.sticks_neutral(2.2)
    for _ in range(round((LASTING + 0.3) / (5 * PERIOD))):
        story.tell(StateValue(battery(12.0, is_low=True)))
        story.sticks_neutral(5 * PERIOD)
    assert story.releases
    assert ("flying", "landing") not in story.changes


@pytest.mark.parametrize("stage", ["commit", "down"])
def test_a_stream_that_ends_with_a_landing_leaves_the_throttle_low(stage):
    """Clients stop at `is_done`; a board that says that it flies while its motors run must not lift it again."""
    story = holding(0.5)
    story.height = 0.15
    for _ in range(200):
        story.tell(StateValue(flight(is_flying=True)))
        story.streams(LandSetpoint, PERIOD)
        if story.status.stage == stage:
            break
    assert story.status.stage == stage
    story.done.clear()
    for _ in range(60):
        story.tell(StateValue(flight(is_flying=True)))
        story.run(PERIOD)
    frames = story.of(SendSticks)
    stale = [frame.counts.throttle for frame in frames if frame.age > 0.3]
    assert len(stale) > 20
    assert max(stale) <= min(frame.counts.throttle for frame in frames if frame.age <= 0.3)
    assert story.releases


def see_aside(story, target, aside=1.5, height=0.3):
    """An image of a target that lies aside."""
    seen = pose(story.now).model_copy(update={"position_flu": (aside, 0.0, -height), "target": target})
    story.tell(PoseSeen(seen))


def test_a_take_off_flies_to_no_target_that_the_aircraft_does_not_stand_on():
    """The question that was not asked: which target is meant? The one seen first, 1.5 m aside, was flown to."""
    story = Story()
    story.tell(MotorsReported(True))
    see_aside(story, "other")
    assert story.streams(TakeOffSetpoint, 0.5, height=1.0) == {"target_unclear"}
    assert story.core.phase is Phase.LEASED


@pytest.mark.parametrize("named", [{"target": "pad"}, {}])
def test_a_take_off_waits_on_the_ground_for_no_image_and_follows_no_target_aside(named):
    story = Story()
    story.tell(MotorsReported(True))
    for _ in range(75):
        if named:
            see_aside(story, "other")
        assert story.streams(TakeOffSetpoint, PERIOD, height=1.0, **named) == {None}
    assert (story.core.phase, story.status.stage) == (Phase.FLYING, "throttle rises")
    for height in (0.20, 0.21, 0.24):
        see_aside(story, "other", height=height + 0.2)
        story.see(height)
        story.streams(TakeOffSetpoint, PERIOD, height=1.0, **named)
    assert story.status.stage == "climbs"
    assert story.of(PublishEstimate)[-1].value.target == "pad"


@pytest.fixture
def climbing(monkeypatch):
    """A take-off to 1 m that stays at 0.6 m, and how long it may climb [s]."""
    monkeypatch.setattr(take_off, "LONGEST_ARRIVAL", 2.0)
    story = Story()
    story.tell(MotorsReported(True))
    story.streams(TakeOffSetpoint, 1.5, height=1.0)
    for height in (0.20, 0.21, 0.24):
        story.see(height)
        story.streams(TakeOffSetpoint, PERIOD, height=1.0)
    story.height = 0.6
    return story, 2.0 + 2.0 * 1.0 / SOON.autopilot.max_climb


def test_a_climb_that_does_not_arrive_is_aborted_and_holds(climbing):
    """Wind, late images or the pilot's throttle kept a take-off in `climbs` for ever."""
    story, longest = climbing
    story.streams(TakeOffSetpoint, longest - 0.5, height=1.0)
    assert (story.core.phase, story.status.stage) == (Phase.FLYING, "climbs")
    story.streams(TakeOffSetpoint, 1.0, height=1.0)
    assert (story.core.phase, story.status.manoeuvre) == (Phase.ABORTED, "hold")
    assert story.status.reason == 'aborted: "climbs" takes too long'
    aborted = [status for status in story.of(PublishStatus) if status.phase is Phase.ABORTED]
    assert {(status.manoeuvre, status.stage) for status in aborted} == {("hold", "")}, "in its first tick, too"
    story.streams(LandSetpoint, 0.5, after_abort=1)
    assert (story.core.phase, story.status.manoeuvre) == (Phase.FLYING, "land")


def test_a_stage_that_a_stall_made_late_is_not_aborted_too(climbing):
    story, longest = climbing
    story.streams(TakeOffSetpoint, longest - 0.5, height=1.0)
    story.now += 2.0
    story.run(0.1)
    assert story.status.reason.startswith("the daemon did not run"), story.status.reason
    assert story.status.aborts == 0


@pytest.mark.parametrize(("is_low", "ends_in"), [(False, Phase.ABORTED), (True, Phase.FREE)])
def test_a_landing_whose_stages_alternate_ends_as_a_whole(is_low, ends_in, monkeypatch):
    """The question that was not asked: what comes when no stage is late, and the aircraft does not come down?

    By an image a second it approached, searched and descended in turn, each for less than it may.
    """
    monkeypatch.setattr(land, "LONGEST_WAIT", 1.0)  # a minute in flight
    story = holding(0.8)
    if is_low:
        story.streams_low(LASTING + 0.3)
        assert story.core.phase is Phase.LANDING
    story.height, began, longest = None, story.now, 12.0 + 1.0 + 0.8 / 0.28
    kind = HoldSetpoint if is_low else LandSetpoint
    for _ in range(round(longest / 1.5) + 2):
        story.see(0.8)
        story.streams(kind, 1.5)
        if story.core.phase not in (Phase.FLYING, Phase.LANDING):
            break
    story.run(0.3)
    assert story.now - began == pytest.approx(longest, abs=2.0)
    reason = story.status.reason
    assert reason.endswith("takes too long"), reason
    assert story.core.phase in (ends_in, Phase.RELEASING)


def test_of_two_targets_in_sight_one_is_named_and_a_low_battery_lands_on_the_one_that_is_flown_by():
    story = Story(2.0)

    def streams(seconds, **fields):
        tokens = set()
        for _ in range(round(seconds / (2 * PERIOD))):
            see_aside(story, "other", height=2.0)
            tokens |= story.streams(HoldSetpoint, 2 * PERIOD, **fields)
        return tokens

    assert "target_unclear" in streams(0.4)
    assert streams(2.4, target="pad") == {None}
    assert story.core.phase is Phase.FLYING
    assert streams(0.2, target="other") == {"target_unclear"}
    for _ in range(round((LASTING + 0.3) / 0.2)):
        story.tell(StateValue(battery(12.0, is_low=True)))
        streams(0.2, target="pad")
    assert story.changes[-1] == ("flying", "landing")


def gate(story, *, is_open):
    """What a board that reports the gate says."""
    story.tell(StateValue(pilot(0.0).model_copy(update={"is_gate_open": is_open, "throttle": None})))


def test_after_an_abort_while_the_sticks_had_no_answer_the_resumed_position_is_flown_and_not_only_reported():
    """The question that was not asked: is what is reported what is flown?

    A memory of the streamed kind said position, the manoeuvre was the hold of the abort, for ever.
    """
    story, place = Story(2.0), {"position": (1.0, 0.0, 2.0), "frame": SetpointFrame.PAD}
    story.see(2.0)
    story.streams(PositionSetpoint, 2.4, **place)
    gate(story, is_open=False)
    story.streams(PositionSetpoint, 0.1, **place)
    assert story.core.phase is Phase.UNANSWERED
    story.abort()
    story.streams(PositionSetpoint, 0.2, **place)
    gate(story, is_open=True)
    story.streams(PositionSetpoint, 1.0, **place)
    story.streams(PositionSetpoint, 0.1, after_abort=2, **place)
    assert (story.core.phase, story.status.manoeuvre) == (Phase.ABORTED, "hold"), "there was no second abort"
    story.streams(PositionSetpoint, 0.5, after_abort=story.status.aborts, **place)
    assert (story.core.phase, story.status.manoeuvre) == (Phase.FLYING, "position")
    assert story.of(PublishError)[-1].value.goal == (1.0, 0.0, 2.0)
    story.abort()
    story.streams(PositionSetpoint, 0.1, after_abort=1, **place)
    assert story.core.phase is Phase.ABORTED, "the number of the first does not end the second"


def test_an_aborted_flight_stays_aborted_over_a_shut_gate():
    story = holding()
    story.abort()
    for is_open in (False, True):
        before = len(story.of(SendSticks))
        gate(story, is_open=is_open)
        story.streams(LandSetpoint, 0.3)
        assert is_open or {frame.wanted for frame in story.of(SendSticks)[before + 1 :]} == {story.level}
    assert (story.core.phase, story.status.manoeuvre) == (Phase.ABORTED, "hold")


@pytest.mark.parametrize("how", ["the sticks act again", "the abort is over"])
def test_the_tick_that_is_reported_as_flying_sends_what_is_flown(how):
    """The tick that found the answer, or resumed while there was none, was reported as flying and sent level sticks."""
    story, fields = holding(), {}
    gate(story, is_open=False)
    story.streams(LandSetpoint, 0.1)
    if how == "the abort is over":
        story.abort()
        story.streams(LandSetpoint, 0.1)
        fields = {"after_abort": story.status.aborts}
    seen, tick = [], story.tick

    def noted():
        frames = [action.wanted for action in tick() if isinstance(action, SendSticks)]
        seen.extend((story.core.phase, bool(story.status.stage), wanted == story.level) for wanted in frames)

    story.tick = noted
    for is_open in (False, True):
        gate(story, is_open=is_open)
        story.streams(LandSetpoint, 0.3, **fields)
    assert set(seen) == {(Phase.UNANSWERED, False, True), (Phase.FLYING, True, False)}
    assert [phase for phase, _, _ in seen] == sorted((phase for phase, _, _ in seen), reverse=True), "once"


def test_without_an_answer_a_climb_shows_no_stage():
    """It showed "the pilot raises his throttle", for as long as it waited in the air."""
    story = holding()
    story.streams(TakeOffSetpoint, 0.3, height=3.0)
    assert story.status.stage == "climbs"
    gate(story, is_open=False)
    story.streams(TakeOffSetpoint, 0.3, height=3.0)
    assert (story.status.phase, story.status.stage) == (Phase.UNANSWERED, "")


HIGHER = {"position": (0.0, 0.0, 2.5), "frame": SetpointFrame.PAD}
CLIMBING = {"velocity": (0.0, 0.0, 0.5), "frame": SetpointFrame.PAD}


def throttles(story, kind, seconds, **fields):
    """The throttle of every stick frame meanwhile [stick]."""
    before = len(story.of(SendSticks))
    story.streams(kind, seconds, **fields)
    return [frame.counts.throttle for frame in story.of(SendSticks)[before:]]


@pytest.mark.parametrize(("kind", "fields"), [(VelocitySetpoint, CLIMBING), (LandSetpoint, {})])
def test_what_has_come_down_by_accident_is_not_lifted_by_itself(kind, fields):
    """The question that was not asked of what is flown: do the feet stand?

    The pilot's throttle pulled a hold, or a landing that was still high, to the ground; as soon as he let go it went
    up again at 30 counts above hover.
    """
    story = holding()
    story.streams(kind, 0.3, **fields)
    story.height = 0.10
    story.streams(kind, 1.0, **fields)
    hover = story.core._sight.carrying_gas - GAS_CENTRE
    assert max(throttles(story, kind, 1.5, **fields)) <= round(hover)
    story.see(0.9)
    assert max(throttles(story, kind, 0.2, **fields)) <= round(hover), "one wrong image lifts no feet"
    story.height = None
    assert max(throttles(story, kind, 0.7, **fields), default=-127) <= round(hover), "blind, too"


def test_one_image_of_feet_on_the_ground_is_enough():
    """A fall to the ground in half a second, and an image a second: the estimate takes it for a wrong one."""
    story = holding()
    story.height = None
    story.streams(LandSetpoint, 0.9)
    story.see(0.10)
    story.streams(LandSetpoint, PERIOD)
    assert max(throttles(story, LandSetpoint, 0.7)) <= round(story.core._sight.carrying_gas - GAS_CENTRE)


def test_who_is_shown_off_the_ground_climbs_again():
    story = holding()
    story.height = 0.10
    story.streams(HoldSetpoint, 2.0)
    story.height = 0.30
    assert max(throttles(story, HoldSetpoint, 0.7)) > story.core._sight.carrying_gas - GAS_CENTRE + 3.0


def test_an_aircraft_whose_motors_stand_still_is_asked_for_no_more_than_carries_it():
    story = holding()
    hover = story.core._sight.carrying_gas - GAS_CENTRE
    assert max(throttles(story, PositionSetpoint, 0.8, **HIGHER)) > hover + 3.0
    story.tell(MotorsReported(False))
    after = throttles(story, PositionSetpoint, 0.5, **HIGHER)[5:]
    assert max(after) <= story.core._sight.carrying_gas - GAS_CENTRE + 0.5


def test_a_falling_aircraft_is_not_handed_over():
    """Its height over the target counts like its place: 1 m above it at -2 m/s was accepted."""
    story, height = Story(), 9.0
    story.see(height)
    for _ in range(200):
        height -= 2.0 * PERIOD
        story.see(height)
        story.streams(HoldSetpoint, PERIOD)
    assert story.core.phase is Phase.LEASED
    assert "a slower aircraft: it moves at 2.0 m/s" in story.status.reason
