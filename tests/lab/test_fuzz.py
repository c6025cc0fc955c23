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


@pytest.mark.parametrize(("right", "limits"), [(RIGHT, requests.LIMITS), (BUS, bus.LIMITS)], ids=["requests", "bus"])
def test_whatever_goes_wrong_is_no_success(right, limits):
    assert requests.holds(right, limits)
    wrongs = [{name: value + 1} for name, value in right.items() if name != "ended"] + [{"ended": ["view: 1"]}]
    assert not any(requests.holds(right | wrong, limits) for wrong in wrongs)


async def test_a_daemon_bears_three_seconds_of_it():
    found = await requests.fuzz(3.0, 7)
    assert min(found[kind] for kind in ("queries", "setpoints", "files")) > 0
    assert found["refused"].total() > 10
    # it has just begun, and still imports
    assert requests.holds(found | {"growth_mb": 0.0}), found


async def test_a_daemon_bears_a_thousand_puts_and_queries_under_every_kind_of_key():
    found = await bus.fuzz_bus(1000, 3, only=())
    assert min(found["sent"][kind] for kind in ("put", "delete", "get", "token")) > 50
    assert found["malformed"] < 200
    assert found["holds"], found
