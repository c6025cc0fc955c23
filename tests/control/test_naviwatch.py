"""What the NaviCtrl flies by itself, told from its flags, its waypoint number and its distances."""

from __future__ import annotations

import pytest

from mkdaemon.control.naviwatch import HANDS, PERIOD, NaviWatch
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.navi import NaviStage
from mkdaemon.telemetry.state import Gps, GpsFix, GpsMode, Position
from tests.control.events import flight
from tests.values import made

HOME = (53.0, 8.0)
AWAY = (53.001, 8.0)


class Watched:
    """A watch, and what the boards tell it, once a tick of 0.1 s."""

    def __init__(self):
        self.facts = VehicleMemory()
        self.watch = NaviWatch(self.facts)
        self.now = 0.0

    def tell(self, *, is_flying=True, home_distance=30.0, target=HOME, position=True, **flags):
        self.now += 0.1
        stamp = Stamp(monotonic=self.now, wall=self.now)
        place = {"target_latitude_deg": target and target[0], "target_longitude_deg": target and target[1]}
        told = flight(is_flying=is_flying).model_copy(update={"stamp": stamp, **place, **flags})
        self.facts.state_received(told, self.now)
        if position:
            self.facts.state_received(at(home_distance, stamp), self.now)
        return self.watch.look(self.now)


def at(home_distance, stamp):
    home = {"home_latitude_deg": HOME[0], "home_longitude_deg": HOME[1], "home_distance": home_distance}
    return made(Position, stamp, latitude_deg=53.0, longitude_deg=8.0, altitude_above_start=2.0, **home)


LIST = {"waypoint_index": 1, "waypoint_count": 1}
GOING = {"gps_mode": GpsMode.COME_HOME, "target": AWAY, **LIST}


@pytest.mark.parametrize(
    ("told", "stage"),
    [
        ({"is_flying": False}, NaviStage.GROUND),
        ({}, NaviStage.FREE),
        (LIST, NaviStage.READY),
        ({"gps_mode": GpsMode.HOLD}, NaviStage.HOLD),
        ({"gps_mode": GpsMode.HOLD, **LIST}, NaviStage.READY),
        ({"gps_mode": GpsMode.COME_HOME}, NaviStage.HOME),
        (GOING, NaviStage.ROUTE),
        (GOING | {"target_reached": True}, NaviStage.AT_POINT),
        (GOING | {"manual_control": True}, NaviStage.OVERRIDDEN),
        (GOING | {"position": False}, NaviStage.NO_POSITION),
    ],
)
def test_every_stage_says_what_the_pilots_hands_do(told, stage):
    found = Watched().tell(**told)
    assert found.stage is stage
    assert found.hands.startswith(HANDS[stage])


def test_without_a_navictrl_and_without_its_flightctrl_nothing_is_said():
    assert NaviWatch(VehicleMemory()).look(1.0) is None
    assert Watched().tell(gps_mode=GpsMode.UNKNOWN) is None
    assert Watched().tell(is_flying=None) is None


@pytest.fixture
def seen():
    return Watched()


def test_a_stage_that_lasts_is_told_once_a_second_and_a_quiet_one_once(seen):
    assert sum(seen.tell(**GOING) is not None for _ in range(30)) == 3
    quiet = Watched()
    assert sum(quiet.tell() is not None for _ in range(30)) == 1


REACHED, HOMEWARD = GOING | {"target_reached": True}, GOING | {"target": HOME}
WITHOUT_LIST = {"gps_mode": GpsMode.COME_HOME, "target": AWAY}


@pytest.mark.parametrize(
    ("told", "stage", "is_done"),
    [
        ([GOING], NaviStage.ROUTE, False),
        ([GOING, HOMEWARD], NaviStage.HOME, True),  # the end of a list is its last point, or the way home after it
        ([REACHED], NaviStage.AT_POINT, True),
        ([REACHED | {"waypoint_count": 3}], NaviStage.AT_POINT, False),
        ([HOMEWARD], NaviStage.ROUTE, False),  # a point at home is not reached yet
        ([HOMEWARD, HOMEWARD | {"target_reached": True}], NaviStage.AT_POINT, True),
        ([REACHED, GOING | {"waypoint_count": 2}], NaviStage.ROUTE, False),  # another list begins anew
        ([REACHED, GOING | {"is_flying": False, "gps_mode": GpsMode.FREE}], NaviStage.GROUND, False),
        ([REACHED, GOING | {"is_flying": False, "gps_mode": GpsMode.FREE}, LIST], NaviStage.READY, False),
        ([{}], NaviStage.FREE, False),
        ([WITHOUT_LIST, WITHOUT_LIST | {"target": HOME}], NaviStage.HOME, False),
        # Within a metre of home is home.
        ([GOING, GOING | {"target": (HOME[0] + 0.9 / 111_000.0, HOME[1])}], NaviStage.HOME, True),
        ([GOING, GOING | {"target": (HOME[0] + 1.1 / 111_000.0, HOME[1])}], NaviStage.ROUTE, False),
    ],
)
def test_a_list_is_done_at_its_last_point_or_on_the_way_home_after_it(seen, told, stage, is_done):
    for each in told:
        seen.now += PERIOD
        found = seen.tell(**each)
    assert (found.stage, found.is_route_done, found.is_home) == (stage, is_done, False)


def test_who_flies_home_is_there_within_five_metres_and_nowhere_without_a_target(seen):
    seen.tell(**GOING)
    assert not seen.tell(**HOMEWARD).is_home
    assert seen.tell(**HOMEWARD | {"home_distance": 5.0}).is_home
    nowhere = Watched()
    nowhere.tell(**GOING)
    assert nowhere.tell(**GOING | {"target": None}) is None
    assert (Watched().tell().waypoint, Watched().tell().waypoints) == (0, 0)


@pytest.mark.parametrize("later", [0.15, 0.1])
def test_a_list_that_was_changed_makes_what_came_before_old_and_what_is_said_at_that_moment(seen, later):
    assert seen.tell(**GOING | {"target_reached": True}).is_route_done
    seen.facts.list_changed(seen.now + later)
    assert seen.tell(**GOING | {"target_reached": True}) is None, "said before the change"
    assert not seen.tell(**GOING).is_route_done


def test_a_receiver_that_is_silent_has_no_position_though_the_board_shows_the_last(seen):
    seen.tell(**GOING)
    stamp = Stamp(monotonic=seen.now, wall=seen.now)
    lost = made(Gps, stamp, satellites=0, fix=GpsFix.NONE, is_home_set=True)
    seen.facts.state_received(lost, seen.now)
    assert seen.tell(**GOING).stage is NaviStage.NO_POSITION


def test_who_holds_the_height_is_said():
    assert "height control flies the height" in Watched().tell(**GOING, altitude_control=True).hands
    assert "the throttle holds the height" in Watched().tell(**GOING, altitude_control=False).hands


@pytest.mark.parametrize(("is_flying", "stage"), [(True, NaviStage.READY), (False, NaviStage.FREE)])
def test_a_list_changed_in_flight_is_ready_before_a_navictrl_counts_its_points(is_flying, stage):
    seen, uncounted = Watched(), {"waypoint_index": 0, "waypoint_count": 2}
    seen.tell(is_flying=is_flying)
    seen.facts.list_changed(seen.now)
    told = [seen.tell(is_flying=is_flying, **uncounted), seen.tell(**uncounted)]
    assert [found.stage for found in told if found is not None][-1] is stage
