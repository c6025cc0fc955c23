"""Verbs as services: what they answer, and what they say when they are refused."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from mkdaemon.gateways.ros2.parameters import BoardSettings
from mkdaemon.gateways.ros2.services import SELF_TEST, SERVICES, Desk, answer, refused
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding, PreflightReport
from tests.gateways.mavlink.rig import FakeVehicle
from tests.gateways.ros2.bagtypes import scene

ROWS = {service.name: service for service in SERVICES}
CHECKS = (
    Finding(name="link", state=CheckState.PASSED, blocks=Blocks.LEASE, token=None, reason="up", fix=""),
    Finding(name="gate", state=CheckState.STANDS, blocks=Blocks.LEASE, token="x", reason="It is shut.", fix="Open."),
    Finding(name="rest", state=CheckState.STANDS, blocks=Blocks.NOTHING, token="x", reason="Advice.", fix=""),
    Finding(name="camera", state=CheckState.UNKNOWN, blocks=Blocks.NOTHING, token=None, reason="Look.", fix=""),
)


class Deck:
    def __init__(self):
        self.done = []

    async def _did(self, name):
        self.done.append(name)
        return f"{name} done"

    def __getattr__(self, name):
        return lambda: self._did(name)


def call(name, refusals=None, data=False):
    uav = FakeVehicle()
    uav.refusals, uav.report = refusals or {}, PreflightReport(is_ready=False, findings=CHECKS)
    desk = Desk(uav, Deck(), scene(), BoardSettings(uav, None))
    return desk, asyncio.run(answer(ROWS[name], desk, SimpleNamespace(data=data, custom_mode=data)))


SENT = {"mode_sent": True}


@pytest.mark.parametrize(
    ("name", "data", "flown", "asked", "reply"),
    [
        *((name, False, name, None, {"message": f"{name} done"}) for name in ("take_off", "hold", "land", "release")),
        *((name, False, None, (name, (), {}), {}) for name in ("stop", "cancel")),
        ("abort", False, None, ("abort", ("asked for in ROS",), {}), {}),
        ("mark", False, None, ("mark", ("marked in ROS",), {}), {}),
        *(
            (f"route_{name}", yes, None, (name, (), {"confirm": yes}), {})
            for name in ("start", "end")
            for yes in (True, False)
        ),
        ("set_mode", "AUTO.TAKEOFF", "take_off", None, SENT),
        ("set_mode", "AUTO.LOITER", "hold", None, SENT),
        ("set_mode", "AUTO.LAND", "land", None, SENT),
        ("set_mode", "STABILIZED", "release", None, SENT),
        ("set_mode", "AUTO.MISSION", None, ("start", (), {"confirm": True}), SENT),
        ("set_mode", "ALTCTL", None, None, {"mode_sent": False}),
    ],
)
def test_verbs_that_fly_go_through_the_deck_and_others_with_their_data_to_the_daemon(name, data, flown, asked, reply):
    desk, given = call(name, data=data)
    assert desk.deck.done == [flown] * (flown is not None)
    assert desk.uav.calls == [asked] * (asked is not None)
    assert reply.items() <= given.items()
    assert name == "set_mode" or (given["success"] and given["message"])


def test_preflight_says_what_stands_with_the_remedy_and_the_self_test_has_a_status_for_every_check():
    _, reply = call("preflight")
    assert reply == {"success": False, "message": "gate: It is shut. Open.\nrest: Advice."}
    _, reply = call("self_test")
    assert reply["passed"] == 0
    levels = {"mk1: link": 0, "mk1: gate": 2, "mk1: rest": 1, "mk1: camera": 1}
    assert [(status.name, status.level) for status in reply["status"]] == list(levels.items())
    assert ROWS["self_test"].type == SELF_TEST
    reply = refused(ROWS["self_test"], scene(), "no daemon")
    assert (reply["passed"], reply["status"][0].message) == (0, "no daemon")
