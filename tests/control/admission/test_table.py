"""The one table: every row refuses exactly in its situation, by its rule, in words that name thing and remedy."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.activeset import Gate, GateKind
from mkdaemon.control.admission.beginnings import (
    BY_HAND,
    BY_TARGET,
    MANOEUVRES,
    BoardRequest,
    Concern,
    ListUpload,
    NaviGoto,
    NewManoeuvre,
    Procedure,
    StartRoute,
    TakeLease,
)
from mkdaemon.control.admission.navirows import HIGH
from mkdaemon.control.admission.row import Rule
from mkdaemon.control.admission.rows import ROWS, findings, is_ready, refusal, refusals, waits_for
from mkdaemon.control.admission.situation import ASIDE, OwedLiveSet, Work
from mkdaemon.control.motionmatch import Match
from mkdaemon.telemetry.control import ControlLine, Obstacle, Phase
from mkdaemon.telemetry.danger import Confirm, Danger, Switch
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.mission import MissionPoint
from mkdaemon.telemetry.procedure import ProcedureProgress, ProcedureState
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.setpoint import PositionSetpoint, SetpointFrame
from mkdaemon.telemetry.state import GpsMode
from mkdaemon.telemetry.vision import EyeState
from tests.control.admission.situations import BLIND, GOOD, SET, battery, eyes, flags, health, reception, sees
from tests.control.events import STAMP, link_state

RUNNING = ProcedureProgress(
    stamp=STAMP, id="p1", verb="settings_backup", holder="bob", state=ProcedureState.RUNNING, step=0, of=0, text="x"
)  # fmt: skip
OWED = OwedLiveSet(3, "settings_restore", "the FlightCtrl has not been met yet")
TEST = Danger(effect="turns motors", confirm=Confirm.ALWAYS, stopped=True, proven=True, turns_motors=True)
IN_FLIGHT = Danger(effect="writes", confirm=Confirm.IN_FLIGHT)
FLYING = flags(is_flying=True)
PLACE = {"latitude_deg": 53.0, "longitude_deg": 8.0, "altitude": 5.0}


def request(**fields):
    return BoardRequest(**({"board": "fc", "name": "motor_test", "is_to_flightctrl": True} | fields))


def points(**fields):
    return ListUpload((MissionPoint(**PLACE), MissionPoint(**(PLACE | fields))))


CASES = [
    ("way to the client", "slow_path", TakeLease(path_delay=0.51, is_early=True), {}),
    ("way to the client", "slow_path", TakeLease(path_delay=math.inf), {}),
    ("holder", "lease_held", TakeLease(holder="bob"), {"holder": "alice", "lease_left": 0.5, "phase": Phase.LEASED}),
    ("release under way", "busy", TakeLease(holder="bob"), {"phase": Phase.RELEASING}),
    ("confirmed procedure", "not_confirmed", Procedure(verb="mixer_write", unconfirmed="it flips", is_early=True), {}),
    ("stick frames", "flying", request(is_slow=True, is_early=True), {"phase": Phase.LEASED}),
    ("stick frames", "flying", request(is_slow=True), {"work": Work(leases=1)}),
    ("stick frames", "flying", Procedure(verb="settings_backup", is_alone=True), {"phase": Phase.FLYING}),
    ("live set", "live_set_owed", TakeLease(is_early=True), {"work": Work(owed=OWED)}),
    ("live set", "live_set_owed", request(danger=IN_FLIGHT, is_confirmed=True), {"work": Work(owed=OWED)}),
    ("live set", "live_set_owed", Procedure(verb="settings_write", needs_live_set=True), {"work": Work(owed=OWED)}),
    ("procedure under way", "busy", TakeLease(is_early=True), {"work": Work(RUNNING, is_alone=True)}),
    ("procedure under way", "busy", request(is_slow=True), {"work": Work(RUNNING)}),
    ("procedure under way", "busy", Procedure(verb="waypoints_read"), {"work": Work(RUNNING)}),
    ("known request", "unsupported", request(unsupported="it came with 2.12"), {}),
    ("writable aircraft", "read_only", request(read_only="nobody knows it"), {}),
    ("never sent", "never", request(danger=Danger(effect="x", never="it drops", instead="Do not.")), {}),
    ("enabled", "not_enabled", request(danger=Danger(effect="x", switch=Switch.RESET)), {}),
    ("motors that stand still", "motors_running", request(danger=TEST, is_confirmed=True), {"motors_running": True}),
    ("motors that stand still", "motors_unknown", request(danger=TEST, is_confirmed=True), {"motors_running": None}),
    (
        "motors that stand still",
        "link_down",
        request(danger=TEST, is_confirmed=True),
        {"motors_running": None, "link": link_state(LinkCondition.MUTE)},
    ),
    ("confirmed request", "not_confirmed", request(danger=TEST), {"motors_running": False}),
    ("confirmed request", "not_confirmed", request(danger=IN_FLIGHT), {"motors_running": True}),
    ("confirmed request", "not_confirmed", request(danger=IN_FLIGHT), {"motors_running": None}),
    ("buzzer", "deaf_too_long", request(name="beep", deaf_time=2.51), {}),
    (
        "proven board",
        "board_unproven",
        request(danger=TEST, is_confirmed=True, unproven="nc answered it"),
        {"motors_running": False},
    ),
    ("motors for a procedure", "in_flight_needed", Procedure(verb="waypoints_upload", is_alone=True, can_fly=True), {}),
    ("motors for a procedure", "motors_running", Procedure(verb="settings_write", is_alone=True), {}),
    (
        "motors for a procedure",
        "motors_unknown",
        Procedure(verb="settings_write", is_alone=True),
        {"motors_running": None},
    ),
    (
        "motors for a procedure",
        "link_down",
        Procedure(verb="settings_write", is_alone=True),
        {"motors_running": None, "link": None},
    ),
    ("places", "point_unusual", points(latitude_deg=53.1), {}),
    ("places", "point_unusual", points(altitude=-1.0), {}),
    ("places", "point_unusual", points(altitude=HIGH + 1.0), {}),
    ("aircraft in the air", "route_on_ground", StartRoute(), {"flight": flags(is_flying=False)}),
    ("aircraft in the air", "route_on_ground", NaviGoto(2.0), {"flight": None}),
    ("no route under way", "route_active", StartRoute(), {"flight": flags(is_flying=True, waypoint_index=2)}),
    ("switch at home", "switch_at_home", NaviGoto(2.0), {"flight": flags(is_flying=True, gps_mode=GpsMode.COME_HOME)}),
    ("position by GPS", "position_poor", NaviGoto(2.0), {"flight": FLYING}),
    ("path", "no_path", NewManoeuvre(Concern.PATH, path="p2"), {}),
    ("estimate", "no_estimate", NewManoeuvre(Concern.HOLD), BLIND),
    ("ground contact", "not_flying", NewManoeuvre(Concern.HOLD), {"flown": Concern.TAKE_OFF, "is_touching": True}),
    ("ground contact", "not_flying", NewManoeuvre(Concern.POSITION), {"flown": Concern.LAND, "is_touching": True}),
    ("one target", "target_unclear", NewManoeuvre(Concern.LAND), {"in_sight": ("pad", "other")}),
    ("one target", "target_unclear", NewManoeuvre(Concern.TAKE_OFF), sees(offset=0.6)),
    (
        "target in use",
        "target_unclear",
        NewManoeuvre(Concern.POSITION, target="other"),
        {"flown": Concern.HOLD},
    ),
    ("frame", "no_frame", NewManoeuvre(Concern.POSITION, SetpointFrame.HOME), {}),
    ("take-off from the ground", "not_on_ground", NewManoeuvre(Concern.TAKE_OFF), {"flown": Concern.STICK}),
    ("trusted source", "source_untrusted", NewManoeuvre(Concern.TAKE_OFF), {"eyes": (eyes(trusted_for=("flight",)),)}),
    (
        "trusted source",
        "source_untrusted",
        NewManoeuvre(Concern.LAND),
        {"eyes": (eyes(trusted_for=("flight", "takeoff")),), "flown": Concern.HOLD},
    ),
]
"""Row, token, what is to begin, and what is put in place of what is well. The checks are in `test_flightrows`."""

WAITING = [
    (
        "board that listens",
        Concern.STICK,
        {"line": ControlLine("v2", Obstacle.DEAF, "fc to listen again")},
        "to listen",
    ),
    ("answer to the sticks", Concern.HOLD, {"unanswered": "the board reports the gate shut"}, "reports the gate shut"),
    ("flying aircraft", Concern.HOLD, {"motors_running": False}, "motors are off"),
    ("flying aircraft", Concern.POSITION, {"flight": flags(is_flying=False)}, "does not fly"),
    ("flying aircraft", Concern.VELOCITY, sees(height=0.2), "feet are 10 cm"),
    ("flying aircraft", Concern.LAND, sees(height=0.02), "feet are 0 cm"),
    ("fresh image", Concern.HOLD, sees(age=0.26), "0.26 s old"),
    ("speed", Concern.POSITION, sees(speed=0.5), "0.5 m/s"),
    ("offset", Concern.LAND, sees(offset=0.7), "0.7 m beside"),
    ("certainty", Concern.VELOCITY, sees(sd=0.16), "16 cm"),
    ("clean images", Concern.HOLD, sees(clean=1.9), "for 2 s"),
    ("running motors", Concern.TAKE_OFF, {"motors_running": False}, "running motors"),
    ("feet on the ground", Concern.TAKE_OFF, sees(height=0.26), "0.2 m above"),
    ("throttle at its lowest", Concern.TAKE_OFF, {"gas_in_use": 76.0}, "may carry"),
]
STANDING = replace(GOOD, **sees(height=0.1), motors_running=True)
"""An aircraft on the ground, from which everything may begin but what flies at a height."""


def row(name):
    return next(each for each in ROWS if each.name == name)


@pytest.mark.parametrize(("name", "token", "beginning", "change"), CASES)
def test_a_row_refuses_in_its_situation_with_thing_and_remedy(name, token, beginning, change):
    error = refusal(beginning, replace(GOOD, **change))
    assert error is not None
    assert error.token == token
    assert Token(token) in row(name).tokens
    assert beginning.concern in row(name).concerns
    assert "{" not in error.reason + error.fix
    assert "(detail)" not in error.reason + error.fix
    assert error.fix
    assert row(name).look(replace(GOOD, **change), beginning).refusal is not None, "it is this row that refuses"


@pytest.mark.parametrize(("name", "concern", "change", "words"), WAITING)
def test_before_the_flight_the_stream_waits_and_in_flight_only_a_change_from_hand_is_refused(
    name, concern, change, words
):
    wanted, found = NewManoeuvre(concern), replace(GOOD if concern is not Concern.TAKE_OFF else STANDING, **change)
    assert refusal(wanted, found) is None
    assert words in waits_for(wanted, found)
    assert waits_for(wanted, replace(found, flown=Concern.HOLD)) == ""
    assert refusal(wanted, replace(found, flown=Concern.POSITION)) is None
    if row(name).rule is Rule.ENTRY:
        for flown in BY_HAND:
            error = refusal(wanted, replace(found, flown=flown))
            assert error is not None
            assert error.token in row(name).tokens
            assert words in error.reason


def test_every_row_has_its_situation():
    checked = {each.name for each in ROWS if each.is_shown}
    assert {name for name, *_ in (*CASES, *WAITING)} | checked | {"height of the place", "named target"} == {
        each.name for each in ROWS
    }
    assert len({each.name for each in ROWS}) == len(ROWS)
    assert {token for each in ROWS for token in each.tokens} <= set(Token)


def test_every_manoeuvre_is_a_setpoint_and_everything_may_begin_where_all_is_well():
    for concern in MANOEUVRES:
        assert refusal(NewManoeuvre(concern), GOOD) is None
    assert waits_for(NewManoeuvre(Concern.HOLD), GOOD) == waits_for(NewManoeuvre(Concern.TAKE_OFF), STANDING) == ""
    given = PositionSetpoint(epoch=1, sequence=1, ttl=0.3, position=(0.0, 0.0, 2.0), frame=SetpointFrame.HOME)
    assert NewManoeuvre.by(given) == NewManoeuvre(Concern.POSITION, SetpointFrame.HOME)


def test_a_step_of_a_procedure_is_not_refused_for_its_procedure():
    step = request(is_slow=True, is_step=True, danger=IN_FLIGHT, is_confirmed=True)
    assert refusal(step, replace(GOOD, work=Work(RUNNING, is_alone=True, owed=OWED), phase=Phase.LEASED)) is None


def test_who_names_a_target_is_flown_by_that_one_or_waits_for_it():
    """The question that was not asked: which target is meant?"""
    named, other = NewManoeuvre(Concern.TAKE_OFF, target="pad"), NewManoeuvre(Concern.HOLD, target="other")
    assert refusal(named, replace(STANDING, in_sight=("other", "pad"))) is None
    assert waits_for(named, replace(STANDING, in_sight=("other", "pad"))) == ""
    assert "an image of other: pad is in sight" in waits_for(other, GOOD)
    by_hand = refusal(other, replace(GOOD, flown=Concern.STICK))
    assert by_hand is not None
    assert by_hand.token == Token.NOT_READY
    assert refusal(replace(other, target="pad"), replace(GOOD, flown=Concern.LAND)) is None
    assert refusal(NewManoeuvre(Concern.POSITION), replace(GOOD, flown=Concern.HOLD, in_sight=("other", "pad"))) is None
    drifted = replace(STANDING, **sees(offset=1.5, height=0.1), in_sight=())
    assert refusal(NewManoeuvre(Concern.TAKE_OFF), drifted).token == Token.TARGET_UNCLEAR
    nothing_seen = replace(drifted, eyes=(eyes(EyeState.DISPUTED, reason="two differ"),))
    assert refusal(NewManoeuvre(Concern.TAKE_OFF), nothing_seen).token == Token.CAMERA_UNFIT, "the cause, not the drift"
    far = replace(named, target="other")
    assert refusal(far, replace(STANDING, **sees(offset=1.5, height=0.1, target="other"))) is None, "it is meant"


def test_points_that_are_meant_and_points_close_by_are_taken():
    far = MissionPoint(**(PLACE | {"latitude_deg": 54.0}))
    assert refusal(request(name="beep", deaf_time=2.5), GOOD) is None
    assert refusal(ListUpload((MissionPoint(**PLACE), far), allow_unusual=True), GOOD) is None
    assert refusal(points(latitude_deg=53.01), GOOD) is None


CHANGES = {
    "loop": {"loop": refuse(Token.LOOP_UNSTABLE, detail="x", cause="y", remedy="z")},
    "battery": {"battery": battery(16.0, is_low=True)},
    "disk": {"free_disk": 1e8},
    "losses": {"health": health(lost=40)},
    "receiver": {"pilot": reception(0.2)},
    "emergency": {"active_set": replace(SET, emergency_throttle=125)},
    "gate": {"active_set": replace(SET, gate=Gate(GateKind.CONSTANT, 0))},
    "camera": {"eyes": (eyes(EyeState.GONE, reason="unplugged"),)},
    "contradiction": {"contradicting": ("forward",)},
    "stamps": {"stamps": Match(0.08, 0.9)},
    "turned": {"stamps": Match(0.0, -0.9)},
    "switch": {"flight": flags(gps_mode=GpsMode.HOLD)},
    "height control": {"flight": flags(altitude_control=True)},
    "speed": sees(speed=2.0),
    "aside": sees(offset=3.0),
    "no estimate": BLIND,
    "guard": {"has_guard": False},
    "deaf": {"line": ControlLine("v2", Obstacle.DEAF, "x")},
    "motors": {"motors_running": False},
    "touching": {"is_touching": True},
    "work": {"work": Work(RUNNING, is_alone=True, owed=OWED)},
    "two targets": {"in_sight": ("pad", "other")},
    "config": {"cfg": ControlConfig()},
}


@st.composite
def situations(draw):
    found = GOOD
    for name in draw(st.sets(st.sampled_from(sorted(CHANGES)), max_size=6)):
        found = replace(found, **CHANGES[name])
    return replace(found, flown=draw(st.sampled_from([None, *MANOEUVRES])), phase=draw(st.sampled_from(list(Phase))))


@given(situations(), st.sampled_from(MANOEUVRES))
def test_in_every_situation_the_rules_hold(found, concern):
    wanted = NewManoeuvre(concern)
    tokens = [error.token for error in refusals(wanted, found)]
    first = refusal(wanted, found)
    assert (first.token if first else None) == (tokens[0] if tokens else None)
    known = {token for each in ROWS if concern in each.concerns for token in each.tokens}
    assert set(tokens) <= known
    if concern in BY_HAND:
        assert tokens == [], "sticks and attitudes are always the way out"
    if found.flown is concern or (found.flown in BY_TARGET and concern in {Concern.HOLD, Concern.LAND}):
        ground = {Token.NOT_FLYING} if found.is_touching and found.flown is not concern else set()
        assert set(tokens) <= {Token.NO_ESTIMATE} | ground, "who flies flies on, or to the way out"
    if concern is Concern.LAND:
        never = {Token.BATTERY_LOW, Token.DISK_FULL, Token.LINK_POOR, Token.RECEIVER_WEAK, Token.EMERGENCY_CLIMBS}
        assert not set(tokens) & never, "nobody is kept in the air"
    if found.flown is None or found.flown in BY_TARGET:
        assert Token.NOT_READY not in tokens
    if found.flown is not None:
        assert waits_for(wanted, found) == ""
    elif tokens:
        assert waits_for(wanted, found)


@given(situations(), st.sampled_from([each for each in BY_TARGET if each is not Concern.TAKE_OFF]))
def test_a_change_from_hand_in_flight_is_refused_for_all_that_refuses_the_first_setpoint(found, concern):
    on_ground = {error.token for error in refusals(NewManoeuvre(concern), replace(found, flown=None))}
    for flown in BY_HAND:
        changed = {error.token for error in refusals(NewManoeuvre(concern), replace(found, flown=flown))}
        assert on_ground <= changed <= on_ground | {Token.NOT_READY, Token.NOT_FLYING}


@given(situations())
def test_what_is_shown_as_ready_is_not_refused(found):
    on_ground, shown = replace(found, flown=None, work=Work(), phase=Phase.FREE), findings(found)
    if is_ready(shown) and found.entry is not None and len(found.in_sight) == 1 and found.entry.offset <= ASIDE:
        assert refusal(TakeLease(holder="alice"), on_ground) is None
        for concern in BY_TARGET:
            assert refusal(NewManoeuvre(concern), on_ground) is None


@given(situations(), st.booleans(), st.booleans())
def test_what_is_refused_early_is_refused_in_the_end(found, is_slow, is_alone):
    for early in (
        TakeLease(path_delay=0.6, is_early=True),
        request(is_slow=is_slow, is_early=True),
        Procedure(verb="x", is_alone=is_alone, is_early=True),
    ):
        at_last = {error.token for error in refusals(replace(early, is_early=False), found)}
        assert {error.token for error in refusals(early, found)} <= at_last


@pytest.mark.parametrize("frame", [None, *(frame for frame in SetpointFrame if frame is not SetpointFrame.HOME)])
@pytest.mark.parametrize("concern", MANOEUVRES)
def test_who_flies_on_as_he_does_is_asked_nothing_that_changes(concern, frame):
    class Flown:
        """A situation of which nothing is known but what is flown; whoever asks for more fails."""

        flown = concern

    assert refusal(NewManoeuvre(concern, frame), Flown()) is None
