"""What a FlightCtrl does with stick frames, as the proving ground tells it; the firmware is the user's."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from lab.hil import generations, navipairs
from lab.hil.generations import REQUESTS, TOGETHER, VALUES, control_frame, show, version_of
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


def test_a_firmware_that_takes_no_stick_frame_fails(monkeypatch, capsys):
    for holds, code in ((True, 0), (False, 1)):
        monkeypatch.setattr(generations, "measure", lambda name, tries, holds=holds: {"firmware": name, "holds": holds})
        assert show(["some"], 3, as_json=True) == code
    assert version_of(bytes((0, 84, 11, 0, 0))) == "0.84a"
    assert json.loads(capsys.readouterr().out.splitlines()[0])["rows"] == [{"firmware": "some", "holds": True}]


@pytest.mark.parametrize(
    ("ended", "lost", "holds"),
    [
        ("no", [], [True, False, True, True]),
        ("yes", [], [True] * 4),
        ("yes", ["it did not land"], [*[True] * 3, False]),
    ],
)
def test_a_pair_whose_sticks_do_not_arrive_or_that_is_lost_fails(monkeypatch, capsys, ended, lost, holds):
    steps = [step("link up", "yes", 0.1), step("sticks reach the FlightCtrl", ended)]
    monkeypatch.setattr(navipairs, "measure", lambda flight, seed: ("0.24b", steps))
    flown = [{"seed": 7, "hold_cm": 3.5, "lost": lost}]
    monkeypatch.setattr(navipairs, "in_order", lambda fly, seeds, jobs, is_alone: flown)
    assert navipairs.show("some", [1], 1, as_json=True) == (not all(holds))
    printed = json.loads(capsys.readouterr().out)
    assert [row["holds"] for row in printed["rows"]] == holds
    assert (printed["navi"], printed["rows"][3]["hold_cm"], printed["rows"][0]["figure"]) == ("0.24b", 3.5, 0.1)


def step(what, ended, figure=None):
    return {"what": what, "ended": ended, "figure": figure}


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
