"""Every screen says the same of a situation, in the same words: what the picture says is the worst."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.status import render
from mkdaemon.gateways.foxglove.diagnostics import Diagnostics
from mkdaemon.gateways.foxglove.names import Names
from mkdaemon.gateways.mavlink.gateway import MavlinkGateway, Options
from mkdaemon.gateways.mavlink.texts import CRITICAL, WARNING
from mkdaemon.gateways.ros2 import diagnostics
from mkdaemon.reading import Reading
from mkdaemon.reading.diagnoses import LEVELS
from mkdaemon.telemetry.tone import Tone
from mkdaemon.view.page.picture import VehiclePicture as Page
from mkdaemon.view.report.verdict import head_of
from mkdaemon.view.top.fleetboard import FleetBoard
from mkdaemon.view.top.panels import ROWS, VehicleBoard
from tests.gateways.mavlink.rig import Ears, FakeVehicle
from tests.gateways.ros2.bagtypes import scene
from tests.reading.situations import AT, SITUATIONS
from tests.view.report.known import BEGIN, taped
from tests.view.report.test_pieces import read

NOW = AT.monotonic


@pytest.fixture(params=SITUATIONS, ids=lambda situation: situation.name)
def situation(request):
    return request.param


@pytest.fixture
def picture(situation):
    reading = Reading()
    show(situation, reading.take)
    return reading.at(NOW)


def show(situation, take):
    """Let a screen take the values of a situation."""
    for key, value in situation.values.items():
        take(key, value, value.stamp.monotonic)


def in_one_line(text):
    return " ".join(text.split())


def test_status_begins_with_it(picture):
    console = Console(width=300)
    with console.capture() as printed:
        console.print(render("mk1", picture))
    assert in_one_line(printed.get().splitlines()[1]) == f"now {picture.headline}"


def test_top_begins_with_it_on_24_rows(situation, picture):
    board = VehicleBoard("mk1")
    show(situation, board.take)
    rows = ["".join(text for text, _ in row) for row in board.rows(NOW)]
    assert in_one_line(" ".join(rows)).startswith(f"mk1 {picture.headline}")
    assert len(rows) == ROWS


def test_the_fleet_says_it(situation, picture):
    board = FleetBoard()
    board.look(["mk1"], NOW)
    show(situation, partial(board.take, "mk1"))
    words = [row[1][0] for row in board.rows(NOW, 0.0)[2:-1]]
    assert in_one_line(" ".join(words)).startswith(picture.headline)


def test_the_page_says_it_in_its_tone(situation, picture):
    page = Page("mk1")
    show(situation, lambda key, value, at: page.take(key, value, 50.0, age=NOW - at))
    assert page.show(50.0)["verdict"] == {"text": picture.headline, "tone": picture.tone}


def test_a_report_says_it_of_the_end(situation, picture):
    tape, _ = taped(situation)
    tape.add(NOW - BEGIN, "bus/counts", {"counts": {}})
    head = head_of(read(tape))
    assert (head.end, head.tone) == (picture.headline, picture.tone)


def test_ros_diagnoses_it_first(situation, picture):
    first, *parts = diagnostics.report(scene(situation.values), AT).status
    assert (first.name, first.message, first.level) == ("mk1: verdict", picture.headline, LEVELS[picture.tone])
    assert len(parts) > 7


def test_foxglove_diagnoses_it_first(situation, picture):
    if picture.is_silent:
        return  # no value comes with which it could be shown
    diagnose, values = (
        Diagnostics(Names("mk1")),
        sorted(situation.values.items(), key=lambda one: one[1].stamp.monotonic),
    )
    messages = [diagnose(key, value) for key, value in values]
    first = json.loads([message for message in messages if message][-1])["status"][0]
    assert (first["name"], first["level"]) == ("verdict", LEVELS[picture.tone])
    assert first["message"] == picture.headline


async def test_mavlink_tells_what_is_wrong(situation, picture):
    gateway = MavlinkGateway(FakeVehicle(), Options((), 1, None, Path("/nonexistent")), lambda: NOW, lambda: 0.0)
    ears = Ears(gateway)
    gateway.picture.now = NOW
    show(situation, lambda _, value, at: gateway.picture.take(value, NOW, age=NOW - at))
    gateway.tick()
    told = {(message.severity, message.text) for message in ears.named("STATUSTEXT")}
    severity = {Tone.BAD: CRITICAL, Tone.WARN: WARNING}.get(picture.tone)
    if severity is None:
        assert told == set()
    else:
        assert ears.words == picture.headline.encode("ascii", "replace").decode()
        assert {level for level, _ in told} == {severity}


def test_it_is_good_only_while_nothing_is_wrong_and_one_line(picture):
    assert "\n" not in picture.headline
    assert (picture.tone is Tone.OK) == (not picture.alarms and picture.tone is not Tone.NOTE)
    for alarm in picture.alarms:
        assert alarm.tone.is_wrong and picture.tone.is_wrong
    tones = [alarm.tone for alarm in picture.alarms]
    assert tones == sorted(tones, key=[Tone.BAD, Tone.WARN].index)
