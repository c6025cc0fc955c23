"""What a FlightCtrl does with stick frames, as the proving ground tells it; the firmware is the user's."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from lab.hil import generations, navipairs
from lab.hil.generations import REQUESTS, TOGETHER, VALUES, Found, control_frame, row_of, show, spread
from lab.hil.navidaemon import Step
from mkdaemon.protocol.framing import FrameDecoder
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        (ExternControlV1, bytes((0, 0, 0, 11, 0xF9, 5, 100, 0, 0, 9, 1, 0))),
        (ExternControlV2, bytes((11, 0xF9, 5, 100, 9, 1, 0, 0, 0))),
    ],
)
def test_a_stick_frame_of_each_layout_has_a_value_of_its_own_in_every_place(kind, payload):
    (frame,) = FrameDecoder().feed(control_frame(kind))
    assert (frame.address, frame.id) == (1, "b")
    assert [value for value in frame.payload if value] == [value for value in payload if value]
    (released,) = FrameDecoder().feed(control_frame(kind, valid=False))
    assert sum(a != b for a, b in zip(frame.payload, released.payload, strict=True)) == 1


def test_every_request_is_asked_for_in_turn_first():
    assert set(TOGETHER[0]) == set(REQUESTS)
    assert len(set(VALUES.values())) == len(VALUES)


def test_what_was_found_is_shown_and_a_firmware_that_takes_no_stick_frame_fails(monkeypatch, capsys):
    held = {"ExternControlV1": (11, -7, 5, 100, True), "ExternControlV2": (0, 0, 0, 0, False)}
    found = Found((0, 84, "a"), held, [0.005], [5.1, 5.2, 5.0], "abdhlpt", "cgnqvz")
    monkeypatch.setattr(generations, "measure", lambda name, tries: found)
    assert show(["some"], 3, as_json=True) == 0
    [row] = json.loads(capsys.readouterr().out)["rows"]
    assert (row["kept_alive_by"], row["layouts"]) == ("abdhlpt", ["ExternControlV1"])
    assert row_of("some", found)["held_s"] == [5.0, 5.1, 5.2]
    assert spread(found.held) == (5.0, 5.1, 5.2)
    assert spread([]) == ()
    found.held.clear()
    assert show(["some"], 3, as_json=False) == 1
    assert "0.84a" in capsys.readouterr().out


def test_a_pair_whose_sticks_do_not_arrive_fails(monkeypatch, capsys):
    steps = [Step("link up", "yes", 0.1), Step("sticks reach the FlightCtrl", "no")]
    monkeypatch.setattr(navipairs, "measure", lambda flight, seed: ("0.24b", steps))
    flown = [{"seed": 7, "hold_cm": 3.5, "lost": []}]
    monkeypatch.setattr(navipairs, "fly_all", lambda flight, seeds, jobs: flown)
    assert navipairs.show("some", [1], 1, as_json=True) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["rows"][0] == {"what": "link up", "ended": "yes", "figure": 0.1}
    assert [row["holds"] for row in printed["rows"][2:]] == [False, True]
    assert (printed["navi"], printed["rows"][3]["hold_cm"]) == ("0.24b", 3.5)
    steps[1] = Step("sticks reach the FlightCtrl", "yes", 0.04)
    assert navipairs.show("some", [1], 1, as_json=False) == 0
    flown[0]["lost"] = ["it did not land"]
    assert navipairs.show("some", [1], 1, as_json=False) == 1
    assert "it did not land" in capsys.readouterr().out


def test_telemetry_of_a_pair_is_compared_with_the_truth():
    truth = SimpleNamespace(pitch=0.1, roll=0.0, yaw=3.1, position_enu=(1.0, 2.0, 3.0))
    values = {
        "state/attitude": SimpleNamespace(pitch=0.1, roll=0.02, yaw=-3.1),
        "state/pilot": SimpleNamespace(throttle_in_use=-10.0),
        "state/altitude": SimpleNamespace(above_start=2.5),
        "state/position": SimpleNamespace(position_enu=(4.0, 6.0, 0.0)),
    }
    assert navipairs.errors_of(values, truth, -12) == pytest.approx(
        {
            "pitch and roll [deg]": 1.146,
            "heading [deg]": 4.766,
            "throttle [count]": 2.0,
            "height by the barometer [m]": 0.5,
            "place by GPS [m]": 5.0,
        },
        abs=1e-3,
    )
    assert navipairs.errors_of({}, truth, 0) == {}
