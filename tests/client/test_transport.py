"""The client's side of the bus where it meets more than it expects, and the errors of its tasks."""

from __future__ import annotations

import asyncio
import time

import pytest
import zenoh

from lab.rigs.programs import PATIENCE
from mkdaemon.bus.answers import BUSY
from mkdaemon.bus.codec import MEDIA_TYPE
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.session import session_config
from mkdaemon.client import connect
from mkdaemon.client.taskerrors import single_error
from mkdaemon.config.bus import BusConfig
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.status import Status
from tests.bus.support import free_endpoint


async def obey(suffix, payload):
    return CommandResult(status=Status.ACCEPTED)


async def test_two_daemons_of_one_name_behind_a_router_are_noticed():
    meeting_point = free_endpoint()
    config = [BusConfig(listen=(free_endpoint(),), connect=(meeting_point,)) for _ in range(2)]
    router = await asyncio.to_thread(zenoh.open, session_config("router", listen=[meeting_point]))
    try:
        async with Bus.open(config[0], "twin") as one, Bus.open(config[1], "twin") as other:
            one.serve("do", obey)
            other.serve("do", obey)
            async with connect("twin", meeting_point) as client:
                deadline = time.monotonic() + PATIENCE
                with pytest.raises(MkError, match="2 daemons of the name twin answered"):
                    while time.monotonic() < deadline:  # until the router knows both
                        try:
                            await client.command("do", "lease", {"action": "show"})
                        except MkError as error:
                            if "daemons of the name" in str(error):
                                raise
                        await asyncio.sleep(0.05)
    finally:
        await asyncio.to_thread(router.close)


async def test_a_query_too_many_has_a_reason_and_a_remedy():
    endpoint = free_endpoint()
    async with Bus.open(BusConfig(listen=(endpoint,)), "full") as bus:
        for root in ("mk/full/do/**", "mk/full/more/**"):
            answers = zenoh.handlers.Callback(lambda query: query.reply_err(BUSY, encoding=MEDIA_TYPE), indirect=False)
            bus.session.declare_queryable(root, answers)
        async with connect("full", endpoint) as client:
            with pytest.raises(CommandRejectedError, match=r"too many queries wait for an answer.*[Tt]ry again"):
                await client.get_all("more/**")
            answer = await client.command("do", "release")
    assert (answer.status, answer.token, bool(answer.fix)) == ("busy", "busy", True)


def test_a_defect_keeps_its_group():
    with pytest.raises(ExceptionGroup) as caught, single_error():
        raise ExceptionGroup("tasks", [MkError("unplugged"), RuntimeError("a defect")])
    assert len(caught.value.exceptions) == 2
