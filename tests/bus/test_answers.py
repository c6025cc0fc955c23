"""Answers to queries hold up neither the loop nor each other, and what ends a flight waits for none of them."""

from __future__ import annotations

import asyncio
import sys
import threading
from contextlib import asynccontextmanager

import pytest
import zenoh

from lab.rigs.waiting import PATIENCE, wait_blocking, wait_for
from mkdaemon.bus.answers import BUSY, MOST_SHED, SHED_BYTES, WAITING_BYTES, AnswerThread
from mkdaemon.bus.floods import URGENT
from mkdaemon.bus.gateway import Bus
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.status import Status
from tests.bus.support import ask, bus_config, client, free_endpoint

ASKER = """
import sys, time, zenoh
from mkdaemon.bus.session import session_config
session = zenoh.open(session_config("client", connect=[sys.argv[1]], lease=10.0))
unread = []
for _ in range(100):
    unread.append(session.get(sys.argv[2], handler=zenoh.handlers.FifoChannel(1), timeout=60))
    print("asked", flush=True)
sys.stdin.read()
import os; os._exit(0)
"""
"""A client that asks and reads no answer: Zenoh stops to read from the line when a channel of one place is full.

Where answers come before all was asked, its own next question waits for that, too, and for ever.
"""


@asynccontextmanager
async def asker_that_does_not_read(endpoint: str, expression: str):
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", ASKER, endpoint, expression, stdin=-1, stdout=-1
    )
    assert await asyncio.wait_for(process.stdout.readline(), PATIENCE) == b"asked\n"
    yield
    process.kill()
    await process.wait()


async def test_a_client_that_reads_no_answer_holds_up_neither_the_loop_nor_a_command():
    endpoint = free_endpoint()
    lags: list[float] = []

    async def measure_lag() -> None:
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + 0.01
            await asyncio.sleep(0.01)
            lags.append(loop.time() - due)

    async def handler(suffix: str, payload: object) -> CommandResult:
        return CommandResult(status=Status.ACCEPTED)

    async with Bus.open(bus_config(endpoint), "t1") as bus:
        bus.serve("do", handler)
        measuring = asyncio.create_task(measure_lag())
        with client(endpoint) as session:
            async with asker_that_does_not_read(endpoint, "mk/t1/schema/**"):
                answers = [await asyncio.to_thread(ask, session, "mk/t1/do/release") for _ in range(20)]
                await asyncio.sleep(1.0)
        measuring.cancel()
    assert [len(answer) for answer in answers] == [1] * 20
    assert max(lags) < 1.0  # 6 s where the loop itself replied


class _Query:
    attachment, parameters = None, ""

    def __init__(self, key_expr: str, payload: bytes | None = None) -> None:
        self.key_expr, self.payload = key_expr, payload
        self.answers: list[object] = []

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        self.answers.append("end")

    def drop(self) -> None:
        self.answers.append("dropped")

    def reply_err(self, payload: bytes, *, encoding: str) -> None:
        self.answers.append(payload)


def test_queries_beyond_the_limits_get_an_error_and_an_answer_that_fails_ends_nothing():
    gate, began = threading.Event(), threading.Event()
    thread = AnswerThread("test", limit=3, limit_per_key=2)
    held, many, others = _Query("held"), [_Query("a") for _ in range(3)], [_Query("b"), _Query("c")]

    def hold(query: zenoh.Query) -> None:
        began.set()
        gate.wait(PATIENCE)
        raise zenoh.ZError("gone")

    thread.submit(held, hold)
    assert began.wait(PATIENCE)
    for query in many + others:
        thread.submit(query, lambda query: query.answers.append("answer"))
    last, done = _Query("last"), threading.Event()
    gate.set()
    while not others[0].answers:  # the last of those that wait
        done.wait(0.01)
    thread.submit(last, lambda query: done.set())
    assert done.wait(PATIENCE)
    thread.close()
    assert held.answers == ["end"]
    assert [query.answers for query in many] == [["answer", "end"], ["answer", "end"], [BUSY, "end"]]
    assert [query.answers for query in others] == [["answer", "end"], [BUSY, "end"]]


def test_of_many_surplus_queries_some_wait_and_only_the_newest_of_them_get_an_error():
    gate, began = threading.Event(), threading.Event()
    thread = AnswerThread("test", limit=3, limit_per_key=1)
    surplus = [_Query("held") for _ in range(1000)]

    def hold(query: zenoh.Query) -> None:
        began.set()
        gate.wait(PATIENCE)

    thread.submit(_Query("held"), hold)
    assert began.wait(PATIENCE)
    for query in surplus:
        thread.submit(query, hold)
    assert all(query.answers == ["dropped"] for query in surplus[MOST_SHED:]), "each would keep 64 kB"
    gate.set()
    answered = surplus[MOST_SHED - MOST_SHED // 2 : MOST_SHED]
    wait_blocking(lambda: answered[-1].answers)
    thread.close()
    assert [query.answers for query in answered] == [[BUSY, "end"]] * len(answered)
    assert all(query.answers == ["dropped"] for query in surplus[: MOST_SHED - len(answered)])


def test_long_queries_that_wait_do_not_fill_the_memory():
    gate, began, done = threading.Event(), threading.Event(), threading.Event()
    thread = AnswerThread("test", limit=256, limit_per_key=256)
    length = 1 << 18
    queries = [_Query("long", bytes(length)) for _ in range(100)]

    def hold(query: zenoh.Query) -> None:
        began.set()
        gate.wait(PATIENCE)

    thread.submit(_Query("held"), hold)
    assert began.wait(PATIENCE)
    for query in queries:
        thread.submit(query, lambda query: query.answers.append("answer"))
    ended_at_once = [query for query in queries if query.answers == ["dropped"]]
    held_bytes = sum(len(query.payload) for query in queries if not query.answers)
    assert held_bytes <= WAITING_BYTES + SHED_BYTES
    assert ended_at_once == queries[-len(ended_at_once) :]
    gate.set()
    wait_blocking(lambda: all(query.answers for query in queries))
    thread.submit(_Query("short"), lambda query: done.set())
    assert done.wait(PATIENCE), "what was given back may be used again"
    thread.close()
    assert [BUSY, "end"] in [query.answers for query in queries]
    assert queries[0].answers == ["answer", "end"]


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
