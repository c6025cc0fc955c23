"""The page in a real browser: true values of a known flight are read back from it, and its buttons are pressed."""

from __future__ import annotations

import math
import re

import cv2
import numpy as np
import pytest

from lab.rigs.browsing import chromium, opened, program, said, wait_until
from mkdaemon.client.samples import read_payload, typed_value
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.reader import Recording
from tests.places import DATA
from tests.reading.situations import LOOKED_AT
from tests.view.report.known import taped

pytestmark = pytest.mark.browser
FLIGHT = DATA / "recordings" / "fc_over_target.mcap"
MKCTL, MKDAEMON = "mkdaemon.cli.mkctl.app", "mkdaemon.cli.mkdaemon.app"


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def last_values():
    """The last value of every key of the known flight."""
    found = {}
    for entry in Recording(FLIGHT).entries(lambda facts: facts.kind is EntryKind.SAMPLE):
        found[entry.suffix] = typed_value(
            entry.encoding.rpartition(";mk.")[2], read_payload(entry.encoding, entry.payload)
        )
    return found


def estimates():
    """Where the aircraft was believed to be, and when it was recorded [s since the beginning]."""
    entries = list(Recording(FLIGHT).entries(lambda facts: facts.kind is EntryKind.SAMPLE))
    begin = min(entry.received for entry in entries)
    found = ((entry.received - begin, entry) for entry in entries if entry.suffix == "control/estimate")
    return [(at, read_payload(entry.encoding, entry.payload)["position"]) for at, entry in found]


def colours(page) -> np.ndarray:
    """The pixels of the scene (n, 3), red first."""
    picture = cv2.imdecode(np.frombuffer(page.locator("#scene").screenshot(), np.uint8), cv2.IMREAD_COLOR)
    return picture.reshape(-1, 3)[:, ::-1].astype(int)


def numbers(text: str) -> list[float]:
    return [float(one) for one in re.findall(r"[-+]?\d+\.?\d*", text)]


def place_of(page) -> list[float]:
    return numbers(said(page, "position").rpartition(": ")[2])[:3]  # behind "STALE 0.6 s: "


def is_as_recorded(page) -> bool:
    """Whether the page shows where the aircraft was at its place of the recording; it changes while it is read."""
    place, shown = numbers(page.locator("#place").inner_text())[0], place_of(page)
    near = [position for at, position in estimates() if abs(at - place) < 0.3]
    return len(shown) == 3 and any(math.dist(shown, position) < 0.02 for position in near)


def test_a_recorded_flight_is_shown_as_it_was(browser):
    words = ("view", str(FLIGHT), "--no-browser", "--port", "0", "--json", "--paused")
    with program(MKCTL, *words) as (address, _), opened(browser, address) as (page, wrong):
        page.wait_for_selector("#play:visible")
        assert page.locator("#kind").inner_text().lower() == "recording"
        page.select_option("#speed", "4")
        wait_until(page, lambda: page.locator("#speed").input_value() == "4", "the speed did not change")
        page.click("#pause")
        wait_until(page, lambda: "ended" in page.locator("#place").inner_text(), "it was not played to its end")
        known = last_values()
        estimate, battery, attitude = known["control/estimate"], known["state/battery"], known["state/attitude"]
        assert place_of(page) == pytest.approx(estimate.position, abs=0.0051)
        assert numbers(said(page, "attitude"))[:2] == pytest.approx(
            [math.degrees(attitude.roll), math.degrees(attitude.pitch)], abs=0.051
        )
        assert numbers(said(page, "battery"))[0] == pytest.approx(battery.voltage, abs=0.051)
        assert "control/error" in known
        assert "not known: no image for" in said(page, "error"), "its last images came before its end"
        assert known["control/status"].hands in said(page, "hands")
        assert said(page, "gps") == "not known"
        assert page.locator("#events li").count() >= 4
        assert page.locator("#abort").is_disabled() and page.locator("#release").is_disabled()
        curve = page.locator("[data-plot=height] [data-curve=seen]").inner_text()
        assert curve.startswith("seen ")
        # A curve has fewer points than values came: its last one is up to a tenth of a second older.
        assert numbers(curve) == pytest.approx([estimate.position[2]], abs=0.01 + 0.1 * abs(estimate.velocity[2]))
        front = np.abs(colours(page) - [210, 48, 44]).max(axis=1) < 60
        assert front.sum() > 20, "the aircraft's nose is not in the scene"
        page.select_option("#speed", "0.25")
        page.locator("#speed").blur()
        for _ in range(2):  # far enough before the first estimate for a machine that is slow to look
            place = page.locator("#place").inner_text()
            page.keyboard.press("ArrowLeft")
            wait_until(page, lambda place=place: page.locator("#place").inner_text() != place, "it did not go back")
        wait_until(page, lambda: said(page, "position") == "not known", "something is estimated on the ground")
        page.locator("#seek").fill("5.8")
        page.locator("#pause").focus()
        page.keyboard.press(" ")
        wait_until(page, lambda: "paused" in page.locator("#place").inner_text(), "it was not paused")
        wait_until(page, lambda: is_as_recorded(page), "the page does not show where the aircraft was")
        assert page.locator("#parts b").count() >= 1 and page.locator("#marks i").count() >= 4
        assert wrong == []


def test_buttons_command_the_aircraft_that_flies(browser, tmp_path):
    words = ("demo", "--view", "--headless", "--fps", "10", "--wind", "none", "--picture", str(tmp_path / "a.svg"))
    with program(MKDAEMON, *words) as (address, process), opened(browser, address) as (page, wrong):
        wait_until(
            page,
            lambda: "over pad" in (said(page, "position") if page.locator("#lines tr").count() else ""),
            "it never flew",
        )
        wait_until(page, lambda: place_of(page)[2] > 1.0, "it did not climb")
        assert page.locator("#kind").inner_text().lower() == "live"
        assert page.locator(".camera").get_attribute("data-outlines") != "0"
        press(page, "abort", "No, go back")
        assert said(page, "control").startswith("demo flies")
        press(page, "abort", "Abort now")
        wait_until(page, lambda: page.locator("#verdict").inner_text().startswith("Aborted"), "abort did nothing")
        held = place_of(page)
        page.wait_for_timeout(1500)
        assert math.dist(held, place_of(page)) < 0.5
        press(page, "release", "Release now")
        wait_until(page, lambda: page.locator("#answer").inner_text().startswith("release: released"), "no answer")
        wait_until(page, lambda: said(page, "control").startswith("no client holds the lease"), "it was not released")
        assert "mkctl view" in said(page, "control")
        assert wrong == []
        output, _ = process.communicate(timeout=120)
    assert process.returncode == 1 and "mkctl view" in output


def press(page, button: str, answer: str) -> None:
    """Press a button, and answer its question."""
    page.click(f"#{button}:enabled")
    page.wait_for_selector("#confirm[open]")
    page.get_by_role("button", name=answer).click()
    page.wait_for_selector("#confirm:not([open])", state="attached")


@pytest.mark.parametrize("situation", LOOKED_AT, ids=lambda situation: situation.name)
def test_the_banner_is_the_worst_thing_in_its_colour(browser, tmp_path, situation):
    tape, picture = taped(situation)
    path = tape.write(tmp_path / "situation.mcap")
    with (
        program(MKCTL, "view", str(path), "--no-browser", "--port", "0", "--json") as (address, _),
        opened(browser, address) as (page, wrong),
    ):
        wait_until(page, lambda: "ended" in page.locator("#place").inner_text(), "it was not played to its end")
        banner = page.locator("#verdict")
        wait_until(page, lambda: banner.inner_text() == picture.headline, f"no banner {picture.headline!r}")
        assert banner.get_attribute("data-tone") == picture.tone
        red, green, blue = map(int, re.findall(r"\d+", banner.evaluate("one => getComputedStyle(one).color"))[:3])
        assert (green > max(red, blue)) == (picture.tone == "ok"), "green only while nothing is wrong"
        assert page.locator("#large b").all_inner_texts()[0].endswith(" m") or situation.ages
        assert page.locator("#abort-meaning").inner_text() != page.locator("#release-meaning").inner_text()
        assert page.locator("#abort.danger").count() == 0 and page.locator("#release.danger").count() == 1
        assert wrong == []
