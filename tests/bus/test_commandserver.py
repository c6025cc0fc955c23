"""What ends a flight waits for no other command and for no answer that is not read."""

from __future__ import annotations

import asyncio
import threading

import pytest

from lab.rigs.waiting import PATIENCE, wait_for
from mkdaemon.bus.floods import URGENT
from mkdaemon.bus.gateway import Bus
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.status import Status
from tests.bus.support import ask, bus_config, client, free_endpoint


@pytest.mark.parametrize("urgent", sorted(URGENT))
async def test_what_ends_a_flight_is_not_busy_while_all_else_is(urgent):
    endpoint = free_endpoint()
    begun, gate = [], asyncio.Event()

    async def handler(suffix: str, payload: object) -> CommandResult:
        begun.append(suffix)
        if suffix not in URGENT:
            await gate.wait()
        return CommandResult(status=Status.ACCEPTED)

    async with Bus.open(bus_config(endpoint, max_queries=2), "t5") as bus:
        bus.serve("do", handler)
        with client(endpoint) as session:
            held = [asyncio.create_task(asyncio.to_thread(ask, session, "mk/t5/do/rates")) for _ in range(2)]
            await wait_for(lambda: len(begun) == 2)
            [(_, other, _)] = await asyncio.to_thread(ask, session, "mk/t5/do/rates")
            [(_, result, _)] = await asyncio.to_thread(ask, session, f"mk/t5/{urgent}")
            gate.set()
            await asyncio.gather(*held)
    assert other["status"] == "busy"
    assert result["status"] == "accepted"


async def test_the_answer_to_a_release_waits_for_no_other_answer(monkeypatch):
    endpoint = free_endpoint()
    gate, blocked = threading.Event(), threading.Event()

    async def handler(suffix: str, payload: object) -> CommandResult:
        return CommandResult(status=Status.ACCEPTED)

    def block(query: object) -> None:
        blocked.set()
        gate.wait(PATIENCE)

    async with Bus.open(bus_config(endpoint, max_queries=1), "t6") as bus:
        bus.serve("do", handler)
        with client(endpoint) as session:
            replies = bus._commands._replies
            submit = replies.submit
            monkeypatch.setattr(replies, "submit", lambda query, work: submit(query, block))
            held = [asyncio.create_task(asyncio.to_thread(ask, session, "mk/t6/do/rates", timeout=1)) for _ in range(9)]
            await wait_for(blocked.is_set)
            [(_, result, _)] = await asyncio.to_thread(ask, session, "mk/t6/do/release")
            gate.set()
            await asyncio.gather(*held, return_exceptions=True)
    assert result["status"] == "accepted"
