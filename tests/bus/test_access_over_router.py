"""Aircraft and ground station on a router with certificates, made by the commands of docs/fleet.md."""

from __future__ import annotations

import asyncio
import re
import shlex
from concurrent.futures import Future
from contextlib import asynccontextmanager
from threading import Thread

import pytest
import zenoh

from lab.rigs.live import VEHICLE, live_daemon
from lab.rigs.processes import Program
from lab.rigs.router import ROUTER
from lab.rigs.waiting import PATIENCE, wait_for
from lab.rigs.walk import blocks_of
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.bus.setpointroot import new_setpoint_root
from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import run
from mkdaemon.client import connect, transport
from mkdaemon.client.fleet import Fleet
from mkdaemon.config.bus import BusConfig
from mkdaemon.errors import MkError
from mkdaemon.view.top.fleetboard import KEYS
from tests.places import DOCS

pytestmark = [pytest.mark.flight, pytest.mark.real_time(tolerance=0.1)]
AIRCRAFT = "mk2.json5"


def type_commands(folder):
    """Type what the page lets its reader type to make the certificates."""
    lines = [line for block in blocks_of(DOCS / "fleet.md") for line in block.text.splitlines()]
    typed = [shlex.split(line, comments=True) for line in lines if line.startswith("mkdaemon security")]
    assert len(typed) == 3
    for _, *words in typed:
        assert run(app, [str(folder) if word == "security" and n > 0 else word for n, word in enumerate(words)]) == 0


class Fleetside:
    """What tests see: where the router listens, the files, and what the aircraft's boards hold."""

    def __init__(self, folder, endpoint):
        self.folder, self.endpoint = folder, endpoint
        self.simulation = None

    @asynccontextmanager
    async def client(self, role):
        async with connect(VEHICLE, self.endpoint, zenoh_file=self.folder / f"{role}.json5") as client:
            yield client


@asynccontextmanager
async def fleetside(folder):
    with reserved_endpoint() as plain:
        side = Fleetside(folder, plain.replace("tcp/", "tls/"))
        router = await Program.start(*ROUTER, "--config", str(folder / "router.json5"), side.endpoint)
        assert await router.first_line() == "listens", router.errors
        bus = BusConfig(listen=(), connect=(side.endpoint,), zenoh_file=folder / AIRCRAFT, lease=30.0)
        try:
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("MK_ZENOH_FILE", str(folder / "observer.json5"))  # of the rig's own observer
                async with live_daemon(bus=bus) as live:
                    patch.undo()
                    side.simulation = live.runtime.simulation
                    yield side
        finally:
            await router.end()


@pytest.fixture(scope="module")
def side(tmp_path_factory):
    """A router, and behind it one aircraft with its daemon, in a thread of their own."""
    folder = tmp_path_factory.mktemp("keys") / "security"
    type_commands(folder)
    ready, loop, stop = Future(), asyncio.new_event_loop(), asyncio.Event()

    async def serve():
        try:
            async with fleetside(folder) as made:
                ready.set_result(made)
                await stop.wait()
        except Exception as error:
            if ready.done():
                raise
            ready.set_exception(error)

    thread = Thread(target=loop.run_until_complete, args=(serve(),), name="fleet")
    thread.start()
    try:
        yield ready.result()
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()
        loop.close()


async def test_an_observer_looks_and_is_refused_with_words(side, monkeypatch):
    monkeypatch.setattr(transport, "DENIAL_LOOK", 1.0)
    async with side.client("observer") as observer:
        assert await observer.vehicles() == [VEHICLE]
        async with Fleet(observer).values(*KEYS) as samples:
            sample = await asyncio.wait_for(anext(aiter(samples)), PATIENCE)
        assert sample.suffix.startswith(f"{VEHICLE}/")
        with pytest.raises(MkError, match=r"access denied: .* may look and not command; use a pilot's"):
            await observer.command("do", "lease", {"action": "take", "holder": "observer"})


async def test_a_stranger_and_who_shows_no_certificate_get_no_connection(side, tmp_path):
    assert run(app, ["security", "new-ca", str(tmp_path / "strangers")]) == 0
    strangers = {"zenoh_file": tmp_path / "strangers" / "pilot.json5"}
    for how, why in ((strangers, "does not trust the certificate"), ({}, None)):
        with pytest.raises(MkError, match=why):
            await open_session(session_config("client", connect=[side.endpoint], patience=0.3, **how))


async def test_nobody_hears_setpoints_below_the_number_or_puts_telemetry(side):
    heard, file = [], side.folder / "pilot.json5"
    session = await open_session(session_config("client", connect=[side.endpoint], zenoh_file=file))
    note = zenoh.handlers.Callback(lambda sample: heard.append(str(sample.key_expr)), indirect=False)
    session.declare_subscriber(f"mk/{VEHICLE}/**", note)
    async with side.client("pilot") as pilot:
        pilot.session.put(f"mk/{VEHICLE}/state/forged", b"full")
        async with pilot.lease() as lease:
            await lease.stick(pitch=3, throttle=0, seconds=0.3)
        await wait_for(lambda: f"mk/{VEHICLE}/setpoint/stick" in heard)
    await close_session(session)
    assert f"mk/{VEHICLE}/state/forged" not in heard
    assert not [key for key in heard if re.fullmatch(rf"mk/{VEHICLE}/setpoint/[^/]+/.*", key)]


def test_behind_a_secured_router_rules_can_speak_of_the_number():
    assert re.fullmatch("setpoint/[0-9a-f]{32}", new_setpoint_root(["tls/10.77.0.1:7447"]))
    assert new_setpoint_root(["tcp/10.77.0.1:7447"]).startswith("setpoint/@")
