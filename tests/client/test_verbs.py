"""Verbs, requests, procedures and absences as methods."""

from __future__ import annotations

import pytest

from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.client import connect
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError, ProtocolError
from mkdaemon.protocol import Board
from mkdaemon.protocol.messages import MotorTest, Settings, SettingsRequest, VersionFc210, VersionRequest
from mkdaemon.telemetry.control import ReleaseOutcome
from tests.bus.support import free_endpoint
from tests.client.fake import VEHICLE, fake_daemon


async def test_verbs_send_their_fields_and_return_values(daemon, uav):
    done = await uav.release("enough")
    assert (done.status, done.is_done, done.sent) == (ReleaseOutcome.CONFIRMED, True, 5)
    assert (await uav.rates("osd", 0.25)).intervals == {"osd": 0.25}
    assert (await uav.rates()).intervals == {"osd": 0.1}
    assert (await uav.labels("nc")).names == ("one", "two")
    wanted = [{"reason": "enough"}, {"stream": "osd", "interval": 0.25}, {}, {"board": "nc"}]
    assert [fields for _, fields in daemon.asked] == wanted
    assert (await uav.schema("Attitude.v1"))["title"] == "Attitude"
    assert await uav.schema("Nothing.v1") is None


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


async def test_a_refusal_carries_token_reason_and_fix(uav):
    with pytest.raises(CommandRejectedError, match="fc did not answer version_request") as refused:
        await uav.request(Board.FC, VersionRequest())
    assert refused.value.token == "timeout"
    assert "mkctl health" in refused.value.fix
    with pytest.raises(CommandRejectedError, match="there is no verb"):
        (await uav.command("do", "backup_everything")).require()


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


async def test_the_status_of_a_vehicle_is_one_value(daemon, uav):
    daemon.publish_attitude(yaw=1.0)
    daemon.say(daemon.phase, "nobody")
    status = await uav.status()
    assert (status.vehicle, status.is_alive) == (VEHICLE, False)
    assert (status.attitude.yaw, status.control.reason) == (1.0, "nobody")
    assert (status.battery, status.age("state/battery")) == (None, None)
    assert status.age("state/attitude") >= 0
    with pytest.raises(MkError, match="did you mean state/attitude"):
        await uav.get("state/atitude")
    assert await uav.get("state/battery") is None
