"""`mkctl view`: the page of a recording, and mistakes in one line."""

from __future__ import annotations

import asyncio
import json
import os
import signal

import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.cli.mkctl import view as viewcommand
from mkdaemon.cli.mkctl.connection import Connection
from mkdaemon.cli.mkctl.view import view
from tests.client.test_play import STICKS
from tests.view.page.test_server import ask


@pytest.fixture(autouse=True)
def no_favour(monkeypatch):
    """What is right for a program of its own is not for that of the tests."""
    monkeypatch.setattr(viewcommand, "favour_threads", lambda: None)


async def test_a_recording_is_served_until_it_is_asked_to_end(capsys):
    looking = asyncio.create_task(view(STICKS, port=0, no_browser=True, paused=True, connection=Connection(json=True)))
    said = ""

    def is_open() -> bool:
        nonlocal said
        said += capsys.readouterr().out
        return "\n" in said or looking.done()

    await wait_until(is_open)
    address = json.loads(said)["address"]
    port = int(address.rsplit(":", 1)[1].strip("/"))
    head, _ = await ask(port, "/")
    assert head.startswith("HTTP/1.1 200 ")
    os.kill(os.getpid(), signal.SIGTERM)
    await looking
