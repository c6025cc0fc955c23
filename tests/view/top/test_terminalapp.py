"""The terminal view driven by keys, on a bus with a fake daemon: what the screen's SVG says is what was published."""

from __future__ import annotations

import asyncio
import re
from contextlib import AsyncExitStack, asynccontextmanager
from html import unescape
from xml.etree import ElementTree

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.program import run
from mkdaemon.client import connect
from mkdaemon.telemetry.state import Attitude, Battery
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.view.top.terminalapp import FleetApp, TopApp
from tests.client.fake import CLOCK, VEHICLE, fake_daemon
from tests.values import made

SVG = "{http://www.w3.org/2000/svg}"


def rows_of(screen):
    """Rows of an SVG that textual drew, by their height."""
    rows = {}
    for text in ElementTree.fromstring(screen).iter(f"{SVG}text"):
        if text.get("y") and text.get("textLength"):
            words = unescape("".join(text.itertext())).replace("\xa0", " ")
            rows.setdefault(float(text.get("y")), []).append((float(text.get("x")), words))
    return ["".join(words for _, words in sorted(parts)) for _, parts in sorted(rows.items())]


def publish_state(bus):
    stamp = CLOCK.stamp()
    bus.publish("health", made(VehicleHealth, stamp, is_alive=True, motors_running=True, battery_cells=4))
    bus.publish("state/attitude", made(Attitude, stamp, roll=0.1745329, pitch=-0.0872665))
    bus.publish("state/battery", made(Battery, stamp, voltage=15.2, current=11.5, used_mah=812, is_low=False))


def patient(monkeypatch):
    """A loaded machine may take seconds from one value to the next."""
    monkeypatch.setattr("mkdaemon.reading.known.SIGN_OF_LIFE", 1e6)
    monkeypatch.setattr("mkdaemon.reading.known.Knowledge.is_stale", lambda *_: False)


class Acts:
    """What was done, and what holds a landing up."""

    def __init__(self):
        self.done = []
        self.lands = asyncio.Event()

    async def release(self, vehicle):
        self.done.append(("release", vehicle))
        return "released, and confirmed"

    async def land(self, vehicle):
        self.done.append(("land", vehicle))
        try:
            await self.lands.wait()
        except asyncio.CancelledError:
            self.done.append(("given up", vehicle))
            raise
        return "landed on pad"


@asynccontextmanager
async def shown():
    """A fake daemon with a known state, and the view on it."""
    async with fake_daemon() as daemon:
        publish_state(daemon.bus)
        acts = Acts()
        view = TopApp(VEHICLE, lambda name: connect(name, daemon.endpoint), release=acts.release, land=acts.land)
        async with view.run_test(size=(80, 24)) as pilot:
            await until(view, lambda text: "15.2 V" in text)
            yield daemon, view, pilot, acts


def screen(view):
    view.draw()
    return "\n".join(rows_of(view.export_screenshot()))


async def until(view, claim):
    """Wait until the screen says something; returns it."""
    text = ""
    for _ in range(200):
        text = screen(view)
        if claim(text):
            return text
        await asyncio.sleep(0.05)
    raise AssertionError(f"the screen never said so:\n{text}")


async def test_the_screen_says_what_was_published_and_asks_before_it_acts(monkeypatch):
    patient(monkeypatch)
    async with shown() as (daemon, view, pilot, acts):
        text = screen(view)
        for words in (
            "in the air: unknown, motors on",
            "roll +10.0°, pitch -5.0°, heading 090°",
            "15.2 V, 3.80 V a cell, 11.5 A, 812 mAh",
        ):
            assert words in text, words
        assert max(len(row) for row in rows_of(view.export_screenshot())) <= 80
        # Another client takes the lease: the question about a landing names who loses it.
        daemon.holder = "\x1bann"
        daemon.say(daemon.phase.FLYING, "ann flies")
        text = await until(view, lambda text: "\\x1bann flies" in text)
        for key, words in (("r", "Release fake now"), ("l", "takes the lease from \\\\x1bann")):
            await pilot.press(key)
            await pilot.pause()
            asked = " ".join(re.findall("┃(.*)┃", "\n".join(rows_of(view.export_screenshot()))))
            assert re.search(words, " ".join(asked.split()))
            await pilot.press("n")
            await pilot.pause()
        assert acts.done == []
        await pilot.press("r", "y")
        await until(view, lambda text: "released, and confirmed" in text)
        assert acts.done == [("release", VEHICLE)]


async def test_leaving_amid_a_landing_is_asked_for_and_gives_it_up():
    async with shown() as (_, view, pilot, acts):
        await pilot.press("l", "y")
        await until(view, lambda text: "land ..." in text)
        await pilot.press("l")
        await until(view, lambda text: "it lands already" in text)
        await pilot.press("q", "n")
        await pilot.pause()
        assert view.is_running
        await pilot.press("q", "y")
        await pilot.pause()
    assert acts.done == [("land", VEHICLE), ("given up", VEHICLE)]


async def test_a_landing_that_ends_says_how():
    async with shown() as (_, view, pilot, acts):
        acts.lands.set()
        await pilot.press("l", "y")
        await until(view, lambda text: "landed on pad" in text)
        await pilot.press("q")
    assert acts.done == [("land", VEHICLE)]


async def test_another_vehicle_is_chosen_from_the_fleet():
    async with shown() as (_, view, pilot, _acts):
        view.board.fleet = [VEHICLE, "other"]
        assert "also: other" in screen(view)
        await pilot.press("v")
        await pilot.pause()
        assert "other" in " ".join(rows_of(view.export_screenshot()))
        await pilot.press("down", "enter")
        text = await until(view, lambda text: text.startswith(" other "))
        assert "15.2 V" not in text
        text = await until(view, lambda text: "no daemon for vehicle other" in text)
        assert "battery   not known" in text


async def test_a_daemon_has_a_row_and_stays_as_gone_when_it_ends(monkeypatch):
    patient(monkeypatch)
    async with AsyncExitStack() as daemons:
        daemon = await daemons.enter_async_context(fake_daemon())
        view = FleetApp(lambda: connect(VEHICLE, daemon.endpoint))
        async with view.run_test(size=(80, 24)):
            await until(view, lambda text: "1 here" in text)

            def said_again(text):
                """A vehicle is seen before its values are asked for: what is said just once may come too early."""
                publish_state(daemon.bus)
                return "15.2 V" in text

            assert VEHICLE in await until(view, said_again)
            await daemons.aclose()
            await until(view, lambda text: "1 GONE" in text)


def test_without_a_terminal_it_says_what_to_use(capsys):
    assert run(mkctl, ["top"]) == 2
    assert "mkctl top needs a terminal; `mkctl status` prints once" in capsys.readouterr().err


@pytest.fixture(autouse=True)
def prompt(monkeypatch):
    monkeypatch.setattr("mkdaemon.view.top.terminalapp.RETRY", 0.1)
