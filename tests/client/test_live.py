"""The library against the whole daemon on simulated boards."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.live import live_daemon
from mkdaemon.errors import CommandRejectedError, LeaseLostError
from mkdaemon.protocol import Board
from mkdaemon.protocol.messages import Settings, SettingsRequest, VersionFc210, VersionRequest

pytestmark = [pytest.mark.flight, pytest.mark.real_time(tolerance=0.1)]


async def test_sticks_reach_the_aircraft_and_another_client_can_take_the_lease():
    async with live_daemon() as live, live.client() as uav, live.client() as other:
        with pytest.raises(LeaseLostError, match=r"other took the lease from me"):
            async with uav.lease(holder="me") as lease:
                await lease.stick(pitch=-12, throttle=5, seconds=0.5)
                output = (await uav.get("control/output")).value
                assert (output.pitch, output.throttle, output.epoch) == (-12, 5, lease.epoch)
                with pytest.raises(CommandRejectedError, match="me holds the lease"):
                    async with other.lease(holder="other"):
                        pytest.fail("one at a time")
                flying = asyncio.create_task(lease.stick(pitch=-12, throttle=5, seconds=60))
                async with other.lease(holder="other", force=True):
                    await flying
        await live.until_phase("free")
        assert await uav.lease.show() is None


async def test_requests_are_answered_by_typed_messages_and_status_by_one_value():
    async with live_daemon() as live, live.client() as uav:
        version = await uav.request(Board.FC, VersionRequest(), VersionFc210)
        assert (version.major, version.minor) == (2, 12)
        assert (await uav.request(Board.FC, SettingsRequest(index=255), Settings)).index == 3
        assert (await uav.get("rx/fc/version")).value.fields == version
        await live.until(lambda: any(value["is_alive"] for value in live.values("health")))
        status = await uav.status()
        assert status.is_alive
        assert status.link.boards == ("fc",)
        assert status.control.lease is None
