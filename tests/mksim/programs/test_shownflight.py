"""A flight in virtual time on a bus: its values with their ages, what the camera tells, and two verbs."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest

from mkdaemon.virtualtime import run_virtually
from mksim.programs.rehearsal import demonstration, simulated_aircraft
from mksim.programs.shownflight import VEHICLE, shown_at
from tests.bus.support import ask, client, free_endpoint

WHOLE = f"mk/{VEHICLE}/"


@pytest.fixture(scope="module")
def answers():
    """What a client is answered two seconds after the beginning."""
    endpoint = free_endpoint()
    found = {}

    async def fly(show_on, session) -> None:
        rehearsal = demonstration(simulated_aircraft(1, "none", 5.0), lambda moment, status: None)
        with show_on(rehearsal.bus, rehearsal.clock) as follow:
            rehearsal.watch(follow)
            flying = asyncio.create_task(rehearsal.fly())
            await asyncio.sleep(2.0)
            for word, key, body in (
                ("values", "**", None),
                ("release", "do/release", {"reason": "seen enough"}),
                ("abort", "do/abort", {"reason": "seen enough"}),
                ("lease", "do/lease", {"action": "show"}),
            ):
                found[word] = await asyncio.to_thread(ask, session, WHOLE + key, body)
            flying.cancel()
            with suppress(asyncio.CancelledError):
                await flying

    with shown_at(endpoint) as show_on, client(endpoint) as session:
        run_virtually(fly(show_on, session))
    return found


def test_last_values_are_answered_with_their_age(answers):
    values = {key.removeprefix(WHOLE): fields for key, fields, _ in answers["values"]}
    assert {"state/attitude", "link/health", "health", "control/status"} <= set(values)
    assert 0.0 <= values["state/attitude"]["age"] < 0.5
    fence = values["control/fence"]
    assert (fence["radius"], fence["height"], fence["floor"]) == (5.0, 6.0, 0.3)


def test_the_camera_tells_what_it_is_and_what_it_sees(answers):
    values = {key.removeprefix(WHOLE): fields for key, fields, _ in answers["values"]}
    assert [target["name"] for target in values["vision/down/setup"]["targets"]] == ["pad"]
    assert values["vision/down/image"]["pixels"].startswith(b"\xff\xd8")
    assert values["vision/down/pose"]["target"] == "pad"
    stats = values["vision/down/stats"]
    assert stats["fps"] == pytest.approx(5.0, abs=0.5) and stats["posed"] > 0.5
    assert 60.0 < stats["latency_p50_ms"] < 110.0


def test_release_and_abort_reach_the_daemon_and_nothing_else_does(answers):
    ((_, released, _),) = answers["release"]
    assert released["status"] == "accepted" and released["reply"]["reason"] == "seen enough"
    ((_, aborted, _),) = answers["abort"]
    assert (aborted["status"], aborted["token"]) == ("denied", "nothing_flown")
    assert answers["lease"] == []
