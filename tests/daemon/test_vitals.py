"""The vehicle's signs of life."""

from __future__ import annotations

from io import StringIO
from types import SimpleNamespace

import pytest
from rich.console import Console

from mkdaemon.cli.mkctl.status import render
from mkdaemon.control.vehicle import VehicleMemory
from mkdaemon.daemon.vitals import status_line, vehicle_health
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.state import Battery
from tests.control.events import STAMP, flight, link_state


def line(read_only=None):
    return SimpleNamespace(firmware={Board.FC: "2.12a"}, dialect=SimpleNamespace(read_only_reason=read_only))


def test_before_the_line_was_opened_the_vehicle_is_not_alive():
    health = vehicle_health(VehicleMemory(), line("unknown firmware"), STAMP, note="a note")
    assert (health.is_alive, health.link, health.read_only) == (False, "absent", "unknown firmware")
    assert (health.motors_running, health.error, health.note) == (None, None, "a note")
    assert health.firmware == {"fc": "2.12a"}


@pytest.mark.parametrize(
    ("condition", "is_alive"), [(LinkCondition.UP, True), (LinkCondition.ONE_WAY, True), (LinkCondition.MUTE, False)]
)
def test_vehicle_alive_is_not_daemon_alive(condition, is_alive):
    facts = VehicleMemory()
    facts.link_changed(link_state(condition))
    assert vehicle_health(facts, line(), STAMP, note="").is_alive is is_alive


def test_a_message_without_error_tells_of_none():
    facts = VehicleMemory()
    facts.state_received(flight(is_flying=True), STAMP.monotonic)
    assert vehicle_health(facts, line(), STAMP, note="").error is None


def test_an_open_bus_is_told_to_everybody():
    health = vehicle_health(VehicleMemory(), line(), STAMP, note="", open_endpoints=("tcp/0.0.0.0:7447",))
    assert health.open_endpoints == ("tcp/0.0.0.0:7447",)
    known = {"health": health.model_dump()}
    with StringIO() as screen:
        Console(file=screen, width=120).print(render("mk1", known))
        assert "OPEN: everybody in the network may fly, at tcp/0.0.0.0:7447" in screen.getvalue()


@pytest.mark.parametrize(
    ("state", "reason", "lost", "words"),
    [
        ("recording", "", 0, "12 entries, 3 MB"),
        ("recording", "", 7, "12 entries, 3 MB, 7 LOST"),
        ("full", "no room", 7, "NOT RECORDING (full): no room, 7 LOST"),
    ],
)
def test_the_screen_says_whether_everything_is_recorded(state, reason, lost, words):
    fields = {"state": state, "reason": reason, "lost": lost, "entries": 12, "total_bytes": 3_000_000}
    with StringIO() as screen:
        Console(file=screen, width=120).print(render("mk1", {"record/status": fields}))
        assert words in screen.getvalue()


def test_the_status_line_says_line_motors_and_who_flies():
    words = status_line(vehicle_health(VehicleMemory(), line(), STAMP, note=""), Phase.FREE)
    assert words == "link absent: the line has not been opened yet; motors unknown; control free"


def test_the_status_line_says_what_is_wrong_with_the_aircraft():
    facts = VehicleMemory()
    facts.state_received(flight(is_flying=False).model_copy(update={"error": "no GPS"}), STAMP.monotonic)
    assert status_line(vehicle_health(facts, line(), STAMP, note=""), Phase.FREE).endswith("; error: no GPS")


def shown(known):
    with StringIO() as screen:
        Console(file=screen, width=200).print(render("mk1", known))
        return " ".join(screen.getvalue().split())


def camera(**fields):
    return {"camera": "down", "state": "ok", "reason": "", "alarms": {}, "fps": 29.7, "posed": 0.5} | fields


@pytest.mark.parametrize(
    ("stats", "pose", "words"),
    [
        ({}, None, "camera down 30 images a second, 50 % gave a pose target none seen yet"),
        ({"state": "silent", "reason": "no image for 3 s"}, None, "camera down silent: no image for 3 s"),
        ({}, 0.04, "target pad 2.14 m away, +2.10 m above it, seen 0.04 s ago"),
        ({}, 7.0, "target NOT SEEN for 7 s; last pad 2.14 m away"),
        ({"alarms": {"dark": "the images are dark"}}, None, "gave a pose; the images are dark"),
    ],
)
def test_the_screen_says_what_each_camera_sees(stats, pose, words):
    known = {"vision/down/stats": camera(**stats)}
    if pose is not None:
        known["vision/down/pose"] = {"target": "pad", "position_target": (0.4, 0.0, 2.1), "age": pose}
    assert words in shown(known)


@pytest.mark.parametrize(
    ("voltages", "words"),
    [
        ((16.6, 13.2), "13.2 V; 3.30 V in each of 4 cells, NEARLY EMPTY"),
        ((16.6, 15.2), "15.2 V; 3.80 V in each of 4 cells"),
    ],
)
def test_the_screen_says_what_a_voltage_means(voltages, words):
    facts = VehicleMemory()
    fields = dict.fromkeys(("current", "used_mah", "is_low"))
    for voltage in voltages:
        facts.state_received(Battery(stamp=STAMP, source="nc/osd", voltage=voltage, **fields), STAMP.monotonic)
    health = vehicle_health(facts, line(), STAMP, note="").model_dump()
    screen = shown({"health": health, "state/battery": fields | {"voltage": voltages[-1]}})
    assert words in screen
    assert ("NEARLY" in screen) is ("NEARLY" in words)


def test_a_silent_gps_receiver_is_told_and_no_number_of_satellites():
    gps = {"satellites": None, "fix": "none", "is_usable": False}
    assert "NO WORD FROM THE RECEIVER" in shown({"state/gps": gps})


@pytest.mark.parametrize(
    ("is_flying", "words"), [(True, "59 s in the air"), (False, "on the ground, GPS free, flew 59 s")]
)
def test_time_flown_is_told_as_that_on_the_ground(is_flying, words):
    fields = {"is_flying": is_flying, "gps_mode": "free", "flying_time": 59.2}
    assert words in shown({"state/flight": fields})
