"""The fuzzer: what it draws, and that it sees what goes wrong."""

from __future__ import annotations

import msgpack
import pytest

from lab.fuzz import bus, requests
from lab.fuzz.requests import REQUESTS, Nonsense
from mkdaemon.telemetry.verbs import VERBS


def test_the_same_seed_draws_the_same_and_every_request_is_drawn():
    first, second = Nonsense(3), Nonsense(3)
    drawn = [first.request() for _ in range(4000)]
    assert drawn == [second.request() for _ in range(4000)]
    assert {suffix for suffix, _ in REQUESTS} <= {suffix for suffix, _ in drawn}
    assert {f"do/{verb.name}" for verb in VERBS} <= {suffix for suffix, _ in drawn}
    assert len({payload for _, payload in drawn}) > 2000


def test_some_of_its_requests_have_the_names_of_their_fields():
    names = ("action", "holder")
    maps = 0
    nonsense = Nonsense(4)
    for _ in range(200):
        try:
            found = msgpack.unpackb(nonsense.payload(names), strict_map_key=False)
        except (ValueError, msgpack.UnpackException):
            continue
        maps += isinstance(found, dict) and bool(found.keys() & set(names))
    assert maps > 40


RIGHT = dict.fromkeys(("unnamed", "unanswered", "uncounted", "unread", "silences", "tracebacks", "exit_code"), 0)
RIGHT |= {"growth_mb": 8.0, "more_descriptors": 3}
BUS = {"silences": 0, "growth_mb": 32.0, "kept_mb": 6.0, "tracebacks": 0, "ended": [], "exit_code": 0}


@pytest.mark.parametrize(
    "wrong",
    [
        {"unnamed": ["do/lease: x"]},
        {"unanswered": ["do/lease"]},
        {"uncounted": 1},
        {"unread": 1},
        {"silences": 1},
        {"growth_mb": 9.0},
        {"more_descriptors": 4},
        {"tracebacks": 1},
        {"exit_code": -9},
    ],
)
def test_whatever_goes_wrong_is_no_success(wrong):
    assert requests.holds(RIGHT)
    assert not requests.holds(RIGHT | wrong)


async def test_a_daemon_bears_three_seconds_of_it():
    found = await requests.fuzz(3.0, 7)
    assert min(found[kind] for kind in ("queries", "setpoints", "files")) > 0
    assert found["refused"].total() > 10
    # it has just begun, and still imports
    assert requests.holds(found | {"growth_mb": 0.0}), found


@pytest.mark.parametrize(
    "wrong",
    [
        {"silences": 1},
        {"growth_mb": 33.0},
        {"kept_mb": 7.0},
        {"tracebacks": 1},
        {"ended": ["view: exit code 1"]},
        {"exit_code": 1},
    ],
)
def test_a_daemon_or_reader_that_minds_a_key_is_no_success(wrong):
    assert requests.holds(BUS, bus.LIMITS)
    assert not requests.holds(BUS | wrong, bus.LIMITS)


async def test_a_daemon_bears_a_thousand_puts_and_queries_under_every_kind_of_key():
    found = await bus.fuzz_bus(1000, 3, only=())
    assert min(found["sent"][kind] for kind in ("put", "delete", "get", "token")) > 50
    assert found["malformed"] < 200
    assert found["holds"], found
