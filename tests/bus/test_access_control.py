"""What `mkdaemon security` makes: a pilot flies, an observer looks, a recorder marks, a stranger gets nothing."""

from __future__ import annotations

import asyncio
import base64
import json
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.keys import Use, roots
from mkdaemon.bus.session import open_session, session_config
from mkdaemon.cli.mkdaemon.security.securing import new_ca
from mkdaemon.errors import MkError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.event import LogEvent
from mkdaemon.telemetry.signature import private_key
from mkdaemon.telemetry.status import Status
from tests.bus.support import PATIENCE, ask, bus_config, free_endpoint, sticks_of
from tests.places import CONFIGS

HELLO = LogEvent(stamp=Stamp(monotonic=1.0, wall=2.0), level="info", text="hello")
LOOKING = ("observer", "recorder", "source")
SECRET, REPORTS = "0123456789abcdef", "positions/mocap/report"


@pytest.fixture(scope="module")
def certificates(tmp_path_factory) -> Path:
    """Two authorities, each with a file for every role."""
    folder = tmp_path_factory.mktemp("certificates")
    for authority in ("ours", "strangers"):
        new_ca(folder / authority)
    return folder


@pytest.fixture
async def guarded(certificates):
    """A daemon's bus behind the samples; what it was commanded, and where it listens."""
    endpoint = free_endpoint().replace("tcp/", "tls/")
    commanded = []

    async def handler(suffix, payload):
        commanded.append(suffix)
        return CommandResult(status=Status.ACCEPTED)

    cfg = bus_config(endpoint, zenoh_file=certificates / "ours" / "daemon.json5")
    async with Bus.open(cfg, "t1", positions={REPORTS: SECRET}) as bus:
        bus.announce()
        bus.serve("do", handler)
        bus.receive_reports(REPORTS, lambda at, raw, by: commanded.append(raw), lambda raw, proof: 1, SECRET)
        bus.receive("setpoint/stick", lambda stamp, raw, proof: commanded.append(raw))
        bus.publish("event/log", HELLO)
        yield bus, endpoint, commanded


@pytest.fixture
def connect(certificates):
    sessions = []

    def open_as(who, endpoint, authority="ours"):
        path = certificates / authority / f"{who}.json5"
        patience = PATIENCE if authority == "ours" else 2.0  # a stranger is turned away until it gives up
        config = session_config("client", connect=[endpoint], zenoh_file=path, patience=patience, lease=PATIENCE)
        session = zenoh.open(config)
        sessions.append(session)
        return session

    yield open_as
    for session in sessions:
        session.close()


@pytest.mark.parametrize("who", LOOKING)
async def test_an_observer_and_a_recorder_look_and_cannot_command_or_fly(guarded, connect, who):
    _, endpoint, commanded = guarded
    watcher = await asyncio.to_thread(connect, who, endpoint)
    pilot = await asyncio.to_thread(connect, "pilot", endpoint)
    [(_, value, _)] = await asyncio.to_thread(ask, watcher, "mk/t1/event/log")
    assert value["text"] == "hello"
    assert await asyncio.to_thread(ask, watcher, "mk/t1/do/release", None, 1.0) == []
    watcher.put(sticks_of(guarded[0]), b"forged")
    await asyncio.to_thread(
        ask, watcher, "mk/t1/event/log"
    )  # the put went the same way, so it has arrived or never will
    pilot.put(sticks_of(guarded[0]), b"mine")
    await wait_until(lambda: b"mine" in commanded)
    assert commanded == [b"mine"]
    marked = [result["status"] for _, result, _ in await asyncio.to_thread(ask, watcher, "mk/t1/do/mark", None, 1.0)]
    assert marked == (["accepted"] if who == "recorder" else [])


@pytest.mark.parametrize(("who", "is_taken"), [("source", True), ("pilot", True), ("observer", False)])
async def test_a_source_and_a_pilot_report_positions_and_no_observer_does(guarded, connect, who, is_taken):
    _, endpoint, commanded = guarded
    sender = await asyncio.to_thread(connect, who, endpoint)
    pilot = await asyncio.to_thread(connect, "pilot", endpoint)
    sender.put(private_key(SECRET, f"mk/t1/{REPORTS}"), b"pose")
    await asyncio.to_thread(ask, sender, "mk/t1/event/log")
    pilot.put(sticks_of(guarded[0]), b"mine")
    await wait_until(lambda: b"mine" in commanded)
    assert (b"pose" in commanded) is is_taken


@pytest.mark.parametrize("who", ["pilot", "observer"])
async def test_nobody_forges_schemas_or_signs_of_life(guarded, connect, who):
    bus, endpoint, _ = guarded
    forger = await asyncio.to_thread(connect, who, endpoint)
    other = await asyncio.to_thread(connect, "pilot", endpoint)
    heard = []
    note = zenoh.handlers.Callback(lambda sample: heard.append(str(sample.key_expr)), indirect=False)
    other.declare_subscriber("mk/t1/**", note)
    other.liveliness().declare_subscriber("mk/**", note, history=True)
    with ExitStack() as tokens:
        for name in ("t1/alive", "t2/alive", *(["t1/client/pilot"] if who == "observer" else [])):
            tokens.enter_context(forger.liveliness().declare_token(f"mk/{name}"))
        forger.put("mk/t1/schema/Attitude.v1", b"{}")
        await asyncio.to_thread(ask, forger, "mk/t1/event/log")  # the same way: what arrives has arrived

        def hears_the_daemon() -> bool:
            bus.publish("event/log", HELLO)
            return "mk/t1/event/log" in heard

        await wait_until(hears_the_daemon)
        await asyncio.to_thread(ask, other, "mk/t1/event/log")
    assert set(heard) == {"mk/t1/alive", "mk/t1/event/log"}
    assert heard.count("mk/t1/alive") == 1  # the daemon's own


async def test_a_certificate_of_another_authority_is_told_why(guarded, certificates, tmp_path):
    _, endpoint, _ = guarded
    file = certificates / "strangers" / "pilot.json5"
    with pytest.raises(MkError, match="does not trust the certificate"):
        await open_session(session_config("client", connect=[endpoint], zenoh_file=file, patience=0.3))
    config = session_config("client", connect=[endpoint], zenoh_file=file, patience=0.3)
    ours = base64.b64encode((certificates / "ours" / "ca.pem").read_bytes()).decode()
    config.insert_json5("transport/link/tls/root_ca_certificate_base64", json.dumps(ours))
    with pytest.raises(MkError, match=r"refuses this client's certificate .*alert"):
        await open_session(config)


def rules_of(file):
    return json.loads(zenoh.Config.from_file(file).get_json("access_control/rules"))


def test_everybody_may_look_at_everything_that_is_published(certificates):
    rules = rules_of(certificates / "ours" / "daemon.json5")
    patterns = {rule["id"]: [zenoh.KeyExpr(one) for one in rule["key_exprs"]] for rule in rules}
    for name in ("look", "hear"):
        for root in roots(Use.PUBLISHED):
            assert any(zenoh.KeyExpr(f"mk/t1/{root}").intersects(one) for one in patterns[name]), root


def test_the_sample_has_the_same_rules(certificates):
    assert rules_of(CONFIGS / "zenoh" / "daemon-tls.json5") == rules_of(certificates / "ours" / "daemon.json5")
