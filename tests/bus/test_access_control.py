"""The TLS and access control samples: they load, a pilot flies, a watcher only looks, a stranger gets nothing."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from lab.rigs.waiting import wait_until
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.keys import Use, roots
from mkdaemon.bus.session import open_session, session_config
from mkdaemon.bus.tls import explain_tls_failure
from mkdaemon.client import connect as connect_client
from mkdaemon.client import transport
from mkdaemon.errors import MkError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.event import LogEvent
from mkdaemon.telemetry.refusals import Status
from tests.bus.support import PATIENCE, ask, bus_config, free_endpoint, sticks_of
from tests.places import CONFIGS

SAMPLES = CONFIGS / "zenoh"
IN_SAMPLES = "configs/zenoh/certificates/"
HELLO = LogEvent(stamp=Stamp(monotonic=1.0, wall=2.0), level="info", text="hello")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory) -> Path:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is needed to make certificates")
    folder = tmp_path_factory.mktemp("certificates")
    for authority in ("ours", "strangers"):
        script = ["sh", str(SAMPLES / "certificates.sh"), str(folder / authority)]
        subprocess.run(script, check=True, capture_output=True)
    return folder


def sample(name, certificates, tmp_path, *, who="pilot", authority="ours"):
    """A sample file with its paths turned to these certificates."""
    text = (SAMPLES / name).read_text(encoding="utf-8")
    assert IN_SAMPLES in text
    text = text.replace(IN_SAMPLES + "pilot", f"{certificates / authority / who}")
    path = tmp_path / f"{who}-{authority}-{name}"
    path.write_text(text.replace(IN_SAMPLES, f"{certificates / authority}/"), encoding="utf-8")
    return path


@pytest.fixture
async def guarded(certificates, tmp_path):
    """A daemon's bus behind the samples; what it was commanded, and where it listens."""
    endpoint = free_endpoint().replace("tcp/", "tls/")
    commanded = []

    async def handler(suffix, payload):
        commanded.append(suffix)
        return CommandResult(status=Status.ACCEPTED)

    cfg = bus_config(endpoint, zenoh_file=sample("daemon-tls.json5", certificates, tmp_path))
    async with Bus.open(cfg, "t1") as bus:
        bus.announce()
        bus.serve("do", handler)
        bus.receive("setpoint/stick", lambda stamp, raw, proof: commanded.append(raw))
        bus.publish("event/log", HELLO)
        yield bus, endpoint, commanded


@pytest.fixture
def connect(certificates, tmp_path):
    sessions = []

    def open_as(who, endpoint, authority="ours"):
        path = sample("client-tls.json5", certificates, tmp_path, who=who, authority=authority)
        patience = PATIENCE if authority == "ours" else 2.0  # a stranger is turned away until it gives up
        config = session_config("client", connect=[endpoint], zenoh_file=path, patience=patience, lease=PATIENCE)
        session = zenoh.open(config)
        sessions.append(session)
        return session

    yield open_as
    for session in sessions:
        session.close()


async def test_a_pilot_looks_and_commands(guarded, connect):
    _, endpoint, commanded = guarded
    pilot = await asyncio.to_thread(connect, "pilot", endpoint)
    [(_, value, _)] = await asyncio.to_thread(ask, pilot, "mk/t1/event/log")
    assert value["text"] == "hello"
    [(_, result, _)] = await asyncio.to_thread(ask, pilot, "mk/t1/do/release")
    assert result["status"] == "accepted"
    pilot.put(sticks_of(guarded[0]), b"sticks")
    await wait_until(lambda: b"sticks" in commanded)


async def test_a_watcher_looks_and_cannot_command_or_fly(guarded, connect):
    _, endpoint, commanded = guarded
    watcher = await asyncio.to_thread(connect, "watcher", endpoint)
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


async def test_nobody_forges_telemetry(guarded, connect):
    _, endpoint, _ = guarded
    heard = []
    pilot = await asyncio.to_thread(connect, "pilot", endpoint)
    other = await asyncio.to_thread(connect, "pilot", endpoint)
    other.declare_subscriber(
        "mk/t1/**", zenoh.handlers.Callback(lambda sample: heard.append(str(sample.key_expr)), indirect=False)
    )

    def hears_us() -> bool:
        guarded[0].publish("event/log", HELLO)
        return "mk/t1/event/log" in heard

    await wait_until(hears_us)
    pilot.put("mk/t1/state/battery", b"full")
    for _ in range(3):
        await asyncio.to_thread(ask, pilot, "mk/t1/event/log")
    assert "mk/t1/state/battery" not in heard


@pytest.mark.parametrize("who", ["pilot", "watcher"])
async def test_nobody_forges_schemas_or_signs_of_life(guarded, connect, who):
    bus, endpoint, _ = guarded
    forger = await asyncio.to_thread(connect, who, endpoint)
    other = await asyncio.to_thread(connect, "pilot", endpoint)
    heard = []
    note = zenoh.handlers.Callback(lambda sample: heard.append(str(sample.key_expr)), indirect=False)
    other.declare_subscriber("mk/t1/**", note)
    other.liveliness().declare_subscriber("mk/**", note, history=True)
    with ExitStack() as tokens:
        for name in ("t1/alive", "t2/alive", *(["t1/client/pilot"] if who == "watcher" else [])):
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


@pytest.mark.parametrize("who", ["pilot", "watcher"])
async def test_a_certificate_of_another_authority_gets_no_connection(guarded, connect, who):
    _, endpoint, _ = guarded
    with pytest.raises(zenoh.ZError):
        await asyncio.to_thread(connect, who, endpoint, "strangers")


async def test_a_certificate_of_another_authority_is_told_why(guarded, certificates, tmp_path):
    _, endpoint, _ = guarded
    file = sample("client-tls.json5", certificates, tmp_path, authority="strangers")
    with pytest.raises(MkError, match="does not trust the certificate"):
        await open_session(session_config("client", connect=[endpoint], zenoh_file=file, patience=0.3))
    ours = file.read_text(encoding="utf-8").replace(f"{certificates}/strangers/ca.pem", f"{certificates}/ours/ca.pem")
    file.write_text(ours, encoding="utf-8")
    with pytest.raises(MkError, match=r"refuses this client's certificate .*alert"):
        await open_session(session_config("client", connect=[endpoint], zenoh_file=file, patience=0.3))


async def test_certificates_that_are_not_there_are_named(tmp_path, certificates):
    file = sample("client-tls.json5", certificates, tmp_path)
    config = session_config("client", connect=["tls/localhost:1"], zenoh_file=file)
    assert explain_tls_failure(config) is None
    config.insert_json5("transport/link/tls/connect_certificate", json.dumps(str(tmp_path / "none.pem")))
    assert "No such file" in explain_tls_failure(config)


async def test_a_watcher_that_commands_is_told_why(guarded, certificates, tmp_path, monkeypatch):
    _, endpoint, commanded = guarded
    monkeypatch.setattr(transport, "DENIAL_LOOK", 0.5)
    file = sample("client-tls.json5", certificates, tmp_path, who="watcher")
    async with connect_client("t1", endpoint, zenoh_file=file) as client:
        with pytest.raises(MkError, match="access denied"):
            await client.command("do", "lease", {"action": "take", "holder": "watcher"})
    assert commanded == []


@pytest.mark.parametrize("who", ["daemon", "pilot", "watcher"])
def test_a_certificate_is_good_for_nothing_else(certificates, who):
    words = ["openssl", "x509", "-in", str(certificates / "ours" / f"{who}.pem"), "-noout", "-text"]
    text = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    assert "Digital Signature" in text
    assert "CA:FALSE" in text
    assert ("TLS Web Server Authentication" in text) is (who == "daemon")
    assert ("localhost" in text) is (who == "daemon")
    assert "TLS Web Client Authentication" in text


def test_the_sample_lets_everybody_look_at_everything_that_is_published():
    rules = json.loads(zenoh.Config.from_file(SAMPLES / "daemon-tls.json5").get_json("access_control/rules"))
    patterns = {rule["id"]: [zenoh.KeyExpr(one) for one in rule["key_exprs"]] for rule in rules}
    for name in ("look", "hear"):
        for root in roots(Use.PUBLISHED):
            assert any(zenoh.KeyExpr(f"mk/t1/{root}").intersects(one) for one in patterns[name]), root
