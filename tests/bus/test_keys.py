"""The table of keys; whatever else is sent on the bus is dropped where it is not understood, and raises nothing."""

from __future__ import annotations

import asyncio
import json
import re

import pytest
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import schema_name
from mkdaemon.bus.gateway import UNKNOWN_SETPOINTS, Bus
from mkdaemon.bus.keys import KEYS, Use, find
from mkdaemon.bus.names import key, received_suffix, received_vehicle, suffix_of
from mkdaemon.bus.schema import schema_json, schema_names
from mkdaemon.telemetry.state import Attitude
from mkdaemon.telemetry.traffic import FrameSample
from tests.bus.support import bus_config, client, free_endpoint
from tests.places import ROOT


def test_every_line_is_a_key_expression_with_a_schema():
    for spec in KEYS:
        zenoh.KeyExpr(key("mk1", spec.pattern))
        assert find(spec.suffix.replace("<", "").replace(">", "")) is spec
        assert spec.about.endswith(".")
        assert not any(chunk.startswith("@") for chunk in spec.suffix.split("/")), "it would hide from wildcards"
        assert bool(spec.when) == (spec.use in {Use.PUBLISHED, Use.CLIENT})
        if spec.carries is not None:
            schema = json.loads(schema_json(schema_name(spec.carries)))
            undescribed = [name for name, field in schema.get("properties", {}).items() if not field.get("description")]
            assert undescribed == [], f"{spec.suffix}: a field without a word on its meaning and unit"


def test_no_two_lines_claim_the_same_key():
    patterns = [zenoh.KeyExpr(spec.pattern) for spec in KEYS]
    clashes = [(str(a), str(b)) for n, a in enumerate(patterns) for b in patterns[n + 1 :] if a.intersects(b)]
    assert clashes == []


def test_keys_are_found_by_their_suffix_and_those_of_other_vehicles_and_unknown_ones_are_none():
    assert (find("state/attitude").carries, find("rx/nc/osd").carries) == (Attitude, FrameSample)
    assert suffix_of("mk1", key("mk1", "state/battery")) == "state/battery"
    with pytest.raises(ValueError, match="not a key of vehicle mk1"):
        suffix_of("mk1", "mk/mk10/state/battery")
    assert [find(suffix) for suffix in ("state/nothing", "state", "rx/nc/osd/more", "state/attitude/more")] == [
        None
    ] * 4
    assert schema_json("Nothing.v1") is None
    assert "OsdData5.v1" in schema_names()
    assert len(schema_names()) == len(set(schema_names()))


SETPOINTS = ("mk/*/setpoint/*", "mk/t1/setpoint/**", "mk/t1/setpoint/x")
EVERYTHING = ("mk/**", "**", "mk/t1/**")
"""They stand for keys of the daemon too, so its Zenoh drops what is put there."""


@pytest.mark.parametrize("put_at", SETPOINTS + EVERYTHING)
async def test_a_put_to_a_wildcard_ends_no_task_of_the_daemon_and_is_counted(put_at):
    endpoint = free_endpoint()
    async with Bus.open(bus_config(endpoint), "t1") as opened:
        opened.receive("setpoint/stick", lambda at, payload, signed_for: None)
        with client(endpoint) as session:
            looking = asyncio.create_task(opened.refuse_uninvited())
            while not looking.done():
                session.put(put_at, b"", congestion_control=zenoh.CongestionControl.BLOCK)
                await asyncio.sleep(0.001)
            await looking
        assert (UNKNOWN_SETPOINTS in opened.take_shed()) == (put_at in SETPOINTS)


async def test_a_token_that_stands_for_many_names_is_nobody():
    endpoint, seen = free_endpoint(), []
    async with Bus.open(bus_config(endpoint), "t1") as opened:
        opened.watch_client("a", lambda name, is_here: seen.append(name))
        with client(endpoint) as session:
            tokens = [session.liveliness().declare_token(one) for one in ("mk/**", "mk/t1/client/*", "mk/t1/client/a")]
            await wait_until(lambda: "a" in seen)
            del tokens
    assert set(seen) == {"a"}


@pytest.mark.parametrize(
    ("whole", "suffix", "vehicle"),
    [
        ("mk/t1/state/gps", "state/gps", "t1"),
        ("mk/t1/setpoint/@0f/stick", "setpoint/@0f/stick", "t1"),
        ("mk/**", None, None),
        ("**", None, None),
        ("mk/*/alive", None, None),
        ("mk/t1/setpoint/*", None, None),
        ("mk/t2/alive", None, "t2"),
        ("mk/t1", None, None),
    ],
)
def test_what_arrived_names_one_key_or_none(whole, suffix, vehicle):
    assert received_suffix("t1", whole) == suffix
    assert received_vehicle(whole) == vehicle


def test_every_callback_of_zenoh_is_one_that_never_raises():
    """The camera's own stands below the bus, and decides nothing about what it takes."""
    allowed = {"src/mkdaemon/bus/callbacks.py", "src/mkdaemon/vision/camera/sources.py"}
    sources = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "src").rglob("*.py")}
    found = {name for name, path in sources.items() if re.search(r"handlers\.Callback\(", path.read_text("utf-8"))}
    assert found == allowed
