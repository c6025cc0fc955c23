"""The fleet view on a real bus: a daemon that is there has a row, and one that goes stays as gone."""

from __future__ import annotations

from contextlib import AsyncExitStack

from mkdaemon.client import connect
from mkdaemon.view.top.fleetapp import FleetApp
from tests.client.fake import VEHICLE, fake_daemon
from tests.view.top.test_terminalapp import patient, publish_state, until


async def test_a_daemon_has_a_row_and_stays_as_gone_when_it_ends(monkeypatch):
    patient(monkeypatch)
    monkeypatch.setattr("mkdaemon.view.top.fleetapp.RETRY", 0.1)
    async with AsyncExitStack() as daemons:
        daemon = await daemons.enter_async_context(fake_daemon())
        view = FleetApp(lambda: connect(VEHICLE, daemon.endpoint))
        async with view.run_test(size=(80, 24)):
            await until(view, lambda text: "1 here" in text)
            publish_state(daemon.bus)
            text = await until(view, lambda text: "15.2 V" in text)
            assert VEHICLE in text
            await daemons.aclose()
            await until(view, lambda text: "1 GONE" in text)
