"""Verbs as services: what they answer, and what they say when they are refused."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from mkdaemon.errors import CommandRejectedError
from mkdaemon.gateways.ros2.parameters import BoardSettings
from mkdaemon.gateways.ros2.services import SELF_TEST, SERVICES, Desk, answer, refused
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding, PreflightReport
from tests.gateways.ros2.bagtypes import scene

ROWS = {service.name: service for service in SERVICES}
CHECKS = (
    Finding(name="link", state=CheckState.PASSED, blocks=Blocks.LEASE, token=None, reason="up", fix=""),
    Finding(name="gate", state=CheckState.STANDS, blocks=Blocks.LEASE, token="x", reason="It is shut.", fix="Open."),
    Finding(name="rest", state=CheckState.STANDS, blocks=Blocks.NOTHING, token="x", reason="Advice.", fix=""),
    Finding(name="camera", state=CheckState.UNKNOWN, blocks=Blocks.NOTHING, token=None, reason="Look.", fix=""),
)


class Uav:
    """Answers every verb; refuses those that are named."""

    def __init__(self, *refusing):
        self.refusing, self.asked = refusing, []
        self.records = SimpleNamespace(mark=lambda text: self._did("mark", text))
        self.route = SimpleNamespace(
            start=lambda confirm: self._did("route_start", confirm, SimpleNamespace(count=3, switch="flies it")),
            end=lambda confirm: self._did("route_end", confirm),
        )

    async def _did(self, name, what=None, reply=None):
        if name in self.refusing:
            raise CommandRejectedError("busy", "A procedure runs.", "Wait.")
        self.asked.append((name, what))
        return reply

    def abort(self, reason):
        return self._did("abort", reason)

    def stop(self):
        return self._did("stop")

    def cancel(self):
        return self._did("cancel", None, SimpleNamespace(verb="settings_backup"))

    def preflight(self):
        return self._did("preflight", None, PreflightReport(is_ready=False, findings=CHECKS))


class Deck:
    def __init__(self):
        self.done = []

    async def _did(self, name):
        self.done.append(name)
        return f"{name} done"

    def __getattr__(self, name):
        return lambda: self._did(name)


def call(name, uav=None, data=False):
    desk = Desk(uav or Uav(), Deck(), scene(), BoardSettings(uav or Uav(), None))
    return desk, asyncio.run(answer(ROWS[name], desk, SimpleNamespace(data=data, custom_mode=data)))


@pytest.mark.parametrize("name", ["take_off", "hold", "land", "release"])
def test_verbs_that_fly_go_through_the_deck(name):
    desk, reply = call(name)
    assert desk.deck.done == [name]
    assert reply == {"success": True, "message": f"{name} done"}


@pytest.mark.parametrize("name", ["abort", "stop", "mark", "cancel"])
def test_other_verbs_go_to_the_daemon(name):
    desk, reply = call(name)
    assert [asked for asked, _ in desk.uav.asked] == [name]
    assert reply["success"]
    assert reply["message"]


@pytest.mark.parametrize("confirm", [True, False])
def test_data_confirms_what_decides_how_the_aircraft_flies(confirm):
    for name in ("route_start", "route_end"):
        desk, reply = call(name, data=confirm)
        assert desk.uav.asked == [(name, confirm)]
        assert reply["success"]


def test_preflight_says_what_stands_and_the_remedy():
    _, reply = call("preflight")
    assert reply == {"success": False, "message": "gate: It is shut. Open.\nrest: Advice."}


def test_the_self_test_has_a_status_for_every_check():
    _, reply = call("self_test")
    assert reply["passed"] == 0
    assert [(status.name, status.level) for status in reply["status"]] == [
        ("mk1: link", 0),
        ("mk1: gate", 2),
        ("mk1: rest", 1),
        ("mk1: camera", 1),
    ]


@pytest.mark.parametrize("name", ["abort", "preflight", "route_start"])
def test_a_refusal_is_an_answer_in_words(name):
    _, reply = call(name, Uav(name))
    assert reply == {"success": False, "message": "busy: A procedure runs. Wait."}


def test_a_self_test_that_is_refused_has_the_words_in_its_status():
    assert ROWS["self_test"].type == SELF_TEST
    reply = refused(ROWS["self_test"], scene(), "no daemon")
    assert (reply["passed"], reply["status"][0].message) == (0, "no daemon")


@pytest.mark.parametrize(
    ("mode", "done"),
    [("AUTO.TAKEOFF", "take_off"), ("AUTO.LOITER", "hold"), ("AUTO.LAND", "land"), ("STABILIZED", "release")],
)
def test_a_mode_as_mavros_names_it_is_the_verb(mode, done):
    desk, reply = call("set_mode", data=mode)
    assert (desk.deck.done, reply) == ([done], {"mode_sent": True})


def test_a_list_is_started_as_a_mode_and_other_modes_are_refused():
    desk, reply = call("set_mode", data="AUTO.MISSION")
    assert (desk.uav.asked, reply) == ([("route_start", True)], {"mode_sent": True})
    desk, reply = call("set_mode", data="ALTCTL")
    assert (desk.deck.done, reply) == ([], {"mode_sent": False})
