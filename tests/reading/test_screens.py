"""Every screen says the same of a situation, in the same words: what the picture says is the worst."""

from __future__ import annotations

import json
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


def picture_of(situation):
    reading = Reading()
    for key, value in situation.values.items():
        reading.take(key, value, value.stamp.monotonic)
    return reading.at(NOW)


def in_one_line(text):
    return " ".join(text.split())


def test_status_begins_with_it(situation):
    console, picture = Console(width=300), picture_of(situation)
    with console.capture() as printed:
        console.print(render("mk1", picture))
    first = printed.get().splitlines()[1]
    assert in_one_line(first) == f"now {picture.headline}"


def test_top_begins_with_it_on_24_rows(situation):
    board, picture = VehicleBoard("mk1"), picture_of(situation)
    for key, value in situation.values.items():
        board.take(key, value, value.stamp.monotonic)
    rows = ["".join(text for text, _ in row) for row in board.rows(NOW)]
    assert in_one_line(" ".join(rows)).startswith(f"mk1 {picture.headline}")
    assert len(rows) == ROWS


def test_the_fleet_says_it(situation):
    board, picture = FleetBoard(), picture_of(situation)
    board.look(["mk1"], NOW)
    for key, value in situation.values.items():
        board.take("mk1", key, value, value.stamp.monotonic)
    words = [row[1][0] for row in board.rows(NOW, 0.0)[2:-1]]
    assert in_one_line(" ".join(words)).startswith(picture.headline)


def test_the_page_says_it_in_its_tone(situation):
    page, picture = Page("mk1"), picture_of(situation)
    for key, value in situation.values.items():
        page.take(key, value, 50.0, age=NOW - value.stamp.monotonic)
    assert page.show(50.0)["verdict"] == {"text": picture.headline, "tone": picture.tone}


def test_a_report_says_it_of_the_end(situation):
    tape, picture = taped(situation)
    tape.add(NOW - BEGIN, "bus/counts", {"counts": {}})
    head = head_of(read(tape))
    assert (head.end, head.tone) == (picture.headline, picture.tone)


def test_ros_diagnoses_it_first(situation):
    latest, picture = situation.values, picture_of(situation)
    first, *parts = diagnostics.report(scene(latest), AT).status
    assert (first.name, first.message, first.level) == ("mk1: verdict", picture.headline, LEVELS[picture.tone])
    assert len(parts) > 7


def test_foxglove_diagnoses_it_first(situation):
    show, picture, messages = Diagnostics(Names("mk1")), picture_of(situation), []
    for key, value in sorted(situation.values.items(), key=lambda item: item[1].stamp.monotonic):
        messages.append(show(key, value))
    if picture.is_silent:
        return  # no value comes with which it could be shown
    first = json.loads([message for message in messages if message][-1])["status"][0]
    assert (first["name"], first["level"]) == ("verdict", LEVELS[picture.tone])
    assert first["message"] == picture.headline


async def test_mavlink_tells_what_is_wrong(situation):
    picture = picture_of(situation)
    gateway = MavlinkGateway(FakeVehicle(), Options((), 1, None, Path("/nonexistent")), lambda: NOW, lambda: 0.0)
    ears = Ears(gateway)
    gateway.picture.now = NOW
    for value in situation.values.values():
        gateway.picture.take(value, NOW, age=NOW - value.stamp.monotonic)
    gateway.tick()
    told = {(message.severity, message.text) for message in ears.named("STATUSTEXT")}
    severity = {Tone.BAD: CRITICAL, Tone.WARN: WARNING}.get(picture.tone)
    if severity is None:
        assert told == set()
    else:
        assert ears.words == picture.headline.encode("ascii", "replace").decode()
        assert {level for level, _ in told} == {severity}


def test_it_is_good_only_while_nothing_is_wrong(situation):
    picture = picture_of(situation)
    assert (picture.tone is Tone.OK) == (not picture.alarms and picture.tone is not Tone.NOTE)
    for alarm in picture.alarms:
        assert alarm.tone.is_wrong and picture.tone.is_wrong
    assert [alarm.tone for alarm in picture.alarms] == sorted(
        (alarm.tone for alarm in picture.alarms), key=[Tone.BAD, Tone.WARN].index
    )


def test_there_are_forty_situations_and_each_is_one_line():
    assert len(SITUATIONS) >= 40
    for situation in SITUATIONS:
        assert "\n" not in picture_of(situation).headline
