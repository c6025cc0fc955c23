"""What is shown of a known flight: true values, their age by the daemon's clock, curves, and what is not known."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mkdaemon.frames import rotation_from_euler
from mkdaemon.reading import Reading
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.path import PathFlown
from mkdaemon.telemetry.play import PlayState, PlayStatus
from mkdaemon.view.page.daemontime import WINDOW, DaemonTime
from mkdaemon.view.page.overview import overview_of
from mkdaemon.view.page.picture import PageReader, VehiclePicture
from tests import samples
from tests.values import made

NOW = 50.0
"""Our own clock when the daemon's shows 1000."""


def picture_of(values, at: float = 1000.0) -> VehiclePicture:
    picture = VehiclePicture("mk1")
    for suffix, value in values:
        picture.take(suffix, value, NOW + value.stamp.monotonic - at)
    return picture


def line(shown, word):
    return next(one for one in shown["lines"] if one["id"] == word)


def may(shown):
    return {word: not offer["why_not"] for word, offer in shown["offers"].items()}


def test_a_hovering_aircraft_is_shown_as_it_is():
    shown, reading = picture_of(samples.hovering(1000.0)).show(NOW), Reading()
    for suffix, value in samples.hovering(1000.0):
        reading.take(suffix, value, value.stamp.monotonic)
    facts = {fact.id: fact.text for fact in reading.at(1000.0).facts}
    assert shown["verdict"] == {"text": "Anna flies: position", "tone": "ok"}
    assert {one["id"]: one["text"] for one in shown["lines"]}.items() <= facts.items()
    assert facts["position"] == "x +0.12 y -0.05 z 2.01 m over pad, ± 2.0 cm"
    aircraft = shown["scene"]["aircraft"]
    assert (aircraft["position"], aircraft["source"], aircraft["frame"]) == ([0.12, -0.05, 2.01], "estimate", "pad")
    np.testing.assert_allclose(aircraft["rotation"], rotation_from_euler(0.1, -0.05, 0.5), atol=1e-4)
    assert aircraft["spread"] == [[0.06, 0.0, 0.0], [0.0, 0.06, 0.0], [0.0, 0.0, 0.03]]
    assert shown["scene"]["goal"] == [0.15, -0.09, 2.0]
    assert shown["scene"]["fence"] == {"radius": 5.0, "height": 6.0, "floor": 0.3}
    assert may(shown) == {"lease": False, "release": True, "abort": True}
    assert [one["text"] for one in shown["large"]] == ["2.01 m", "15.5 V", "0.1 s"]
    json.dumps(shown, allow_nan=False)


def test_a_path_is_shown_while_it_is_flown():
    value = made(PathFlown, samples.stamp(1000.0), target="pad", points=((0.0, 0.0, 2.0), (1.0, 0.5, 2.0)))
    picture = picture_of([*samples.hovering(1000.0), ("control/path", value)])
    assert picture.show(NOW)["scene"]["path"] == [[0.0, 0.0, 2.0], [1.0, 0.5, 2.0]]
    assert "path" not in picture.show(NOW + 5.0)["scene"]


def test_values_grow_old_while_nothing_comes_and_a_last_one_has_the_age_it_had():
    picture = picture_of(samples.hovering(1000.0))
    shown = picture.show(NOW + 10.0)
    assert line(shown, "attitude")["age"] == pytest.approx(10.0)
    assert [one["id"] for one in shown["lines"] if not one["is_stale"] and one["text"] != "not known"] == []
    assert [one["text"] for one in shown["large"]] == ["10 s old"] * 3
    assert shown["scene"]["aircraft"]["is_stale"] and shown["scene"]["aircraft"]["age"] == pytest.approx(10.05)
    assert shown["scene"]["goal"] is None
    assert may(shown) == {"lease": True, "release": True, "abort": True}
    assert shown["verdict"] == {"text": "NOTHING FROM THE DAEMON: silent for 10 s", "tone": "bad"}
    picture = VehiclePicture("mk1")
    picture.take("state/attitude", samples.attitude(900.0), NOW, age=100.0)
    assert line(picture.show(NOW), "attitude")["age"] == pytest.approx(100.0)
    assert line(picture.show(NOW), "attitude")["is_stale"]


def test_a_daemon_that_is_gone_leaves_no_button_and_what_does_not_fly_is_not_aborted():
    picture = picture_of(samples.hovering(1000.0))
    picture.is_here = False
    shown = picture.show(NOW)
    assert shown["verdict"] == {"text": "No daemon is here", "tone": "bad"}
    assert may(shown) == {"lease": False, "release": False, "abort": False}
    free = samples.status(1000.0, phase=Phase.FREE, lease=None, manoeuvre=None)
    assert not may(picture_of([("control/status", free)]).show(NOW))["abort"]
    ignored = samples.status(1000.0, phase=Phase.UNANSWERED)
    assert may(picture_of([("control/status", ignored)]).show(NOW))["abort"]


def test_without_an_estimate_it_is_where_a_camera_saw_it_or_the_receiver_says():
    picture = picture_of([*samples.hovering(990.0), ("vision/down/pose", samples.pose(1000.0))])
    aircraft = picture.show(NOW)["scene"]["aircraft"]
    assert (aircraft["source"], aircraft["position"], aircraft["age"]) == ("pose", [0.0, 0.0, 2.0], 0.0)
    assert sorted(np.linalg.norm(np.array(aircraft["spread"]), axis=0)) == pytest.approx([0.03, 0.03, 0.06])
    picture = picture_of(samples.keyed(samples.attitude(1000.0), samples.position(1000.0)))
    aircraft = picture.show(NOW)["scene"]["aircraft"]
    assert (aircraft["source"], aircraft["frame"], aircraft["position"]) == ("gps", "home", [1.0, 2.0, 3.0])


def test_the_frustum_of_a_camera_that_looks_down_lies_below_the_aircraft_and_needs_a_calibration():
    picture = picture_of(samples.keyed(samples.setup(1000.0), samples.pose(1000.0)))
    (camera,) = picture.show(NOW)["cameras"]
    frustum = camera["frustum"]
    assert frustum["apex"] == [0.0, 0.0, 2.0]
    # 640 x 480 px at f = 400 px: 0.8 and 0.6 m to the sides for each metre; the top left looks forward and left.
    np.testing.assert_allclose(frustum["ground"][0], [1.2, 1.6, 0.0], atol=5e-3)
    np.testing.assert_allclose(frustum["image"][0], [0.36, 0.48, 1.4], atol=5e-3)
    assert len(frustum["ground"]) % 4 == 0 and len(frustum["image"]) == 4
    (camera,) = picture_of(samples.keyed(samples.setup(1000.0, lens=None), samples.pose(1000.0))).show(NOW)["cameras"]
    assert camera["frustum"] is None and camera["outlines"] == []


def test_tags_are_outlined_in_the_image_in_which_they_were_found():
    found = samples.tags(999.5, sequence=7), samples.pose(999.6, sequence=8), samples.image(999.5, sequence=7)
    picture = picture_of(samples.keyed(samples.setup(999.0), *found))
    (camera,) = picture.show(NOW)["cameras"]
    (outline,) = camera["outlines"]
    assert (outline["id"], outline["how"], outline["corners"][0]) == (48, "decoded", (200.0, 100.0))
    assert (camera["image"], camera["is_stale"]) == ({"sequence": 7}, False)
    picture.take("vision/down/image", samples.image(999.6, sequence=8), NOW)
    (camera,) = picture.show(NOW)["cameras"]
    (outline,) = camera["outlines"]
    assert (outline["id"], outline["how"]) == (None, "tracked")
    # The print of 0.3 m at 2 m: 30 px to each side of the middle; x of the target is x of the image.
    np.testing.assert_allclose(outline["corners"][0], [289.5, 209.5], atol=1e-3)


def test_a_page_is_sent_what_it_does_not_have_yet():
    picture = picture_of(samples.hovering(1000.0))
    reader = PageReader(picture)
    first = reader.read(NOW)
    assert first["series"]["trail"] == [(1000.0, 0.12, -0.05, 2.01)]
    assert first["series"]["sticks"] == [(1000.0, 10, -5, 0, 3, 30.0, -5.0, 0.0, 3.0, 1.0)]
    assert first["series"]["error"] == [(1000.0, 5.0, 1.0)]
    assert first["series"]["latency"] == [(1000.0, 21.0, 20.0, 44.0)]
    assert first["shapes"]["tags"] == [{"id": 48, "corners": samples.SQUARE, "cells": ("##", "#.")}]
    assert first["is_anew"]
    second = reader.read(NOW)
    assert second["series"] == {} and "shapes" not in second and not second["is_anew"]
    picture.take("control/estimate", samples.estimate(1000.5, position=(0.2, 0.0, 2.0)), NOW + 0.5)
    assert reader.read(NOW + 0.5)["series"] == {"trail": [(1000.5, 0.2, 0.0, 2.0)], "height": [(1000.5, 2.0)]}
    assert PageReader(picture).read(NOW + 0.5)["series"]["trail"] == [
        (1000.0, 0.12, -0.05, 2.01),
        (1000.5, 0.2, 0.0, 2.0),
    ]


def playing(place, state=PlayState.PLAYING, speed=1.0, starts=1):
    return made(PlayStatus, state=state, speed=speed, place=place, length=60.0, starts=starts)


def test_ages_stand_still_while_a_recording_is_paused_and_run_as_fast_as_it_is_played():
    picture = picture_of(samples.hovering(1000.0))
    picture.is_played = True
    picture.take_play(playing(5.0, PlayState.PAUSED), NOW)
    shown = picture.show(NOW + 100.0)
    assert line(shown, "attitude")["age"] == pytest.approx(0.0)
    assert shown["play"]["state"] == "paused"
    assert may(shown) == {"lease": False, "release": False, "abort": False}
    picture = picture_of(samples.hovering(1000.0))
    picture.take_play(playing(5.0, speed=4.0), NOW)
    assert line(picture.show(NOW + 1.0), "attitude")["age"] == pytest.approx(4.0)


def test_a_recording_that_begins_again_and_another_boot_begin_anew():
    picture = picture_of(samples.hovering(1000.0))
    reader = PageReader(picture)
    reader.read(NOW)
    assert not picture.take_play(playing(50.0), NOW)
    assert picture.take_play(playing(0.0, starts=2), NOW + 1.0)
    picture.take("control/estimate", samples.estimate(960.0), NOW + 1.0)
    shown = reader.read(NOW + 1.0)
    assert shown["is_anew"] and shown["series"]["trail"] == [(960.0, 0.12, -0.05, 2.01)]
    assert line(shown, "battery")["text"] == "not known"
    assert line(shown, "position")["age"] == pytest.approx(0.0)
    picture = picture_of(samples.hovering(1000.0))
    later = samples.attitude(3.0)
    picture.take("state/attitude", later.model_copy(update={"stamp": samples.stamp(3.0, boot="b")}), NOW + 60.0)
    shown = picture.show(NOW + 60.0)
    assert line(shown, "attitude")["age"] == pytest.approx(0.0)
    assert line(shown, "battery")["text"] == "not known"


def test_an_aircraft_that_is_calculated_without_images_is_one_of_the_past_and_has_no_error():
    values = [(suffix, value) for suffix, value in samples.hovering(1000.0) if suffix != "control/estimate"]
    blind = ("control/estimate", samples.estimate(1000.0, image_age=2.0))
    picture = picture_of([blind, *values])
    shown = picture.show(NOW)
    assert shown["scene"]["aircraft"]["is_stale"]
    assert shown["scene"]["caption"] == "over pad, estimate of the flight core; last image 2.0 s ago"
    assert line(shown, "error")["text"] == "not known: no image for 2.0 s"
    assert [point[1:] for point in picture.series["error"].since(0)] == [(None, None)]


def test_parts_follow_each_other_and_marks_have_their_place():
    free = {"phase": Phase.FREE, "lease": None, "manoeuvre": None}
    statuses = [
        samples.status(1000.0, **free),
        samples.status(1004.0, manoeuvre="takeoff"),
        samples.status(1005.0, manoeuvre="takeoff"),
        samples.status(1009.0, manoeuvre="hold"),
        samples.status(1020.0, **free),
    ]
    late, early = samples.refusal(1006.0), samples.refusal(1002.0)
    found = overview_of([*statuses, late, early, object()]).as_map(1000.0)
    assert [(part["begin"], part["text"]) for part in found["parts"]] == [
        (0.0, ""),
        (4.0, "takeoff"),
        (9.0, "hold"),
        (20.0, ""),
    ]
    assert [(mark["at"], mark["tone"]) for mark in found["marks"]] == [(2.0, "bad"), (6.0, "bad")]


def test_a_page_is_told_once():
    picture = VehiclePicture("mk1", is_played=True)
    picture.take_play(PlayStatus.model_validate(playing(0.0).model_dump() | {"zero": 1000.0}), NOW)
    picture.flight = overview_of([samples.status(1001.0, manoeuvre="hold")])
    reader = PageReader(picture)
    assert reader.read(NOW)["flight"]["parts"] == [{"begin": 1.0, "text": "hold"}]
    assert "flight" not in reader.read(NOW)


def test_a_clock_that_is_slower_is_followed_and_runs_at_the_speed_of_a_recording():
    time = DaemonTime()
    for tick in range(101):
        time.take(100.0 + 0.09 * tick, 0.1 * tick)
    assert time.now(10.0) == pytest.approx(109.0, abs=2 * 0.1 * WINDOW)
    time = DaemonTime()
    time.take(100.0, 0.0)
    time.play_at(4.0, 0.0)
    assert time.now(2.0) == 108.0
    time.play_at(0.0, 2.0)
    assert time.now(50.0) == 108.0
    time.restart()
    assert time.now(50.0) is None
