"""Verbs, requests, procedures and absences as methods."""

from __future__ import annotations

import pytest

from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.client import connect
from mkdaemon.errors import ConfigError, MkError, ProtocolError
from mkdaemon.protocol import Board
from mkdaemon.protocol.messages import MotorTest, Settings, SettingsRequest, VersionFc210
from tests.bus.support import free_endpoint
from tests.client.fake import VEHICLE, fake_daemon


async def test_a_request_returns_the_typed_reply_and_danger_is_confirmed_only_by_the_caller(daemon, uav):
    reply = await uav.request(Board.FC, SettingsRequest(index=255), Settings)
    assert (reply.index, reply.parameters) == (3, bytes(range(100)))
    assert daemon.asked[-1] == ("cmd/fc/settings_request", {"index": 255})
    with pytest.raises(ProtocolError, match="fc answers settings_request with Settings, not VersionFc210"):
        await uav.request(Board.FC, SettingsRequest(index=255), VersionFc210)
    assert await uav.request(Board.FC, MotorTest(motors=(0,) * 16)) is None
    assert "confirm" not in daemon.asked[-1][1]
    await uav.request(Board.FC, MotorTest(motors=(0,) * 16), confirm=True)
    assert daemon.asked[-1][1]["confirm"] is True
    with pytest.raises(ProtocolError, match="with nothing, not Settings"):
        await uav.request(Board.FC, MotorTest(motors=(0,) * 16), Settings)


async def test_a_missing_daemon_is_named_beside_those_that_are_there():
    async with fake_daemon() as daemon, connect("other", daemon.endpoint) as uav:
        for ask in (uav.status(), uav.rates(), uav.release()):
            with pytest.raises(MkError, match=r"no daemon for vehicle other at tcp/.*; there is fake: use --vehicle"):
                await ask
        assert await uav.vehicles() == [VEHICLE]
    with pytest.raises(MkError, match="no program answers at"):
        async with connect(VEHICLE, free_endpoint()):
            pytest.fail("there is nobody")


async def test_a_router_that_does_not_reach_a_vehicle_says_so():
    """Its link is cut, or it does not run: `mkdaemon run` on the ground would be the wrong advice."""
    endpoint = free_endpoint()
    router = await open_session(session_config("router", listen=[endpoint]))
    try:
        async with connect("mk2", endpoint) as uav:
            for ask in (uav.status(), uav.preflight()):
                with pytest.raises(MkError, match=r"the router at tcp/.* does not reach vehicle mk2: its link is cut"):
                    await ask
    finally:
        await close_session(router)


async def test_name_and_endpoint_come_from_the_environment_unless_given(monkeypatch):
    async with fake_daemon() as daemon:
        monkeypatch.setenv("MK_CONNECT", daemon.endpoint)
        monkeypatch.setenv("MK_VEHICLE", VEHICLE)
        async with connect() as uav:
            assert uav.vehicle == VEHICLE
            assert (await uav.rates()).intervals == {"osd": 0.1}
        async with connect("other") as uav:
            assert uav.vehicle == "other"
    with pytest.raises(ConfigError, match="'no good'"):
        async with connect("no good"):
            pytest.fail("this is no name")
