"""`python -m lab fleet --case cut`: three aircraft, each in a network of its own; the link of one is lossy, and is cut.

Ground: a Zenoh router, `mkctl log record`, the fleet view, and a client that flies the second aircraft by sticks. Every
process reads the same monotonic clock, so times of the recordings and of the ground compare.
"""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import AsyncIterator, Awaitable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

from lab.fleet.findings import CutFindings, Refusal, longest_gap
from lab.fleet.members import RECEIVING, ROUTER, Aircraft, Member, say
from lab.fleet.network import Place
from lab.fleet.radio import Air, RadioLink
from lab.fleet.watcher import NAMES, WATCHED, Watcher
from lab.rigs.processes import MKCTL, START, wait_for_control
from lab.rigs.waiting import running, wait_until
from mkdaemon.bus.names import ROOT
from mkdaemon.client import Vehicle, connect
from mkdaemon.errors import MkError
from mkdaemon.record.entry import EntryKind, unpacked
from mkdaemon.record.reader import Recording
from mkdaemon.record.summary import summarise

CUT: Final = "mk2"
"""The one with the radio link."""
ENDPOINT: Final = "tcp/127.0.0.1:7447"
"""Of the router, for what is on the ground; in an aircraft's network, of its daemon."""
BEFORE: Final = 5.0
"""All is well for so long before the flight [s]."""
FLOWN: Final = 2.0
"""Flown before the cut [s]."""
AFTER: Final = 4.0
"""Measured after telemetry has come back [s]."""
PATIENCE: Final = 30.0
"""Longest wait for what should heal [s]."""
MOMENTS: Final = (0.2, 4.0)
"""When an aircraft that is cut off is asked [s after the cut]: before the router has noticed, and later."""


@asynccontextmanager
async def fleet(folder: Path, air: Air, seed: int) -> AsyncIterator[tuple[dict[str, Aircraft], dict[str, Place]]]:
    """Three aircraft and a router while the context lasts; this process stands on the ground."""
    async with AsyncExitStack() as stack:
        places: dict[str, Place] = {}
        for number, name in enumerate(NAMES, 1):
            places[name] = Place(number, air if name == CUT else None, seed)
            stack.callback(places[name].close)
        router = await Member.start(*ROUTER, "tcp/0.0.0.0:7447", threads=RECEIVING)
        stack.push_async_callback(router.end)
        await router.first_line()
        aircraft: dict[str, Aircraft] = {}
        for name, place in places.items():
            aircraft[name] = await Aircraft.start(
                name, folder / name, 4001, router=f"tcp/{place.ground}:7447", listen=[ENDPOINT], prefix=place.prefix
            )
            stack.push_async_callback(aircraft[name].end)
        yield aircraft, places


async def cut(folder: Path, seconds: float, air: Air, seed: int) -> CutFindings:
    """Cut the link of one aircraft for some time, and look.

    Args:
        folder: of all files.
        seconds: length of the cut.
        air: the link that is cut, while it is not.
        seed: of its losses.

    Raises:
        ConfigError: network namespaces or devices are not permitted here.
        TimeoutError: the fleet did not come up.
    """
    findings = CutFindings(seconds, air.loss, air.delay)
    async with fleet(folder, air, seed) as (aircraft, places), connect(CUT, ENDPOINT) as client:
        recorder = await Member.start(
            *MKCTL, "log", "record", "--folder", str(folder / "ground"), "--connect", ENDPOINT
        )
        watcher = Watcher(client)
        say("the router and three aircraft are started")
        radio = places[CUT].radio
        assert radio is not None
        try:
            async with running(watcher.run()):
                await wait_until(lambda: all(watcher.state(name) == "here" for name in NAMES), START)
                await wait_for_control(client, START)
                begin, end = await _through_the_cut(client, watcher, radio, findings)
        finally:
            say("ending")
            await recorder.end(signal.SIGINT)
        findings.exit_codes = [await one.end() for one in aircraft.values()]
    _read_black_box(aircraft[CUT].recordings, begin, end, findings)
    _read_ground(sorted((folder / "ground").glob("*.mcap")), findings)
    return findings


async def _through_the_cut(
    client: Vehicle, watcher: Watcher, radio: RadioLink, findings: CutFindings
) -> tuple[float, float]:
    """Before, while and after; returns when the link was cut and when it came back [s; monotonic]."""
    say("all are here")
    await asyncio.sleep(BEFORE)
    engaged = asyncio.Event()
    flying = asyncio.create_task(_fly(client, engaged), name="pilot")
    try:
        async with asyncio.timeout(START):
            await engaged.wait()
    except TimeoutError:
        flying.cancel()
        raise
    say(f"a client flies {CUT}")
    await asyncio.sleep(FLOWN)
    radio.cut()
    begin = time.monotonic()
    say(f"the link of {CUT} is cut")
    asking = asyncio.create_task(_ask(client, begin, findings), name="asking")
    await asyncio.sleep(findings.cut_for)
    await asking
    radio.restore()
    end = time.monotonic()
    findings.cut_for = round(end - begin, 2)
    say("it is back")
    with suppress(TimeoutError):
        await wait_until(lambda: watcher.times[CUT][-1] > end and watcher.state(CUT) == "here", PATIENCE)
    findings.told_stale = watcher.first(CUT, "stale", begin)
    findings.told_gone = watcher.first(CUT, "gone", begin)
    findings.told_back = watcher.first(CUT, "here", end)
    findings.fresh = next((at - end for at in watcher.times[CUT] if at > end), None)
    say(f"{CUT} is {watcher.state(CUT)}")
    told, findings.client_words = await flying
    say(f"its client: {findings.client_words}")
    findings.client_told = told - begin
    await _take_again(client, end, findings)
    await asyncio.sleep(AFTER)
    for name in NAMES:
        if name != CUT:
            findings.others |= watcher.between(name, begin, time.monotonic())
            gap = longest_gap(watcher.heard[name], begin, end)
            findings.others_gap = max(findings.others_gap, gap)
    return begin, end


async def _fly(client: Vehicle, engaged: asyncio.Event) -> tuple[float, str]:
    """Fly by sticks until the lease is lost; returns when, and why. A flight that does not begin is tried again."""
    while True:
        try:
            async with client.lease() as lease:
                await lease.stick(throttle=-1.0, seconds=0.5)
                engaged.set()
                await lease.stick(pitch=0.1, throttle=-1.0, seconds=600.0)
        except MkError as error:
            if engaged.is_set():
                return time.monotonic(), str(error)
            say(f"{CUT} is not flown: {error}")
        await asyncio.sleep(1.0)


async def _take_again(client: Vehicle, since: float, findings: CutFindings) -> None:
    with suppress(TimeoutError):
        async with asyncio.timeout(PATIENCE):
            while True:
                with suppress(MkError):
                    async with client.lease():
                        findings.leased_again = time.monotonic() - since
                        return
                await asyncio.sleep(0.2)


async def _ask(client: Vehicle, begin: float, findings: CutFindings) -> None:
    """Ask the aircraft that is cut off: from a program, and by `mkctl`."""
    first, later = MOMENTS
    await asyncio.sleep(max(begin + first - time.monotonic(), 0.0))
    await asyncio.gather(
        _refusal("status, of a program", client.status(), begin, findings),
        _refusal("preflight, of a program", client.preflight(), begin, findings),
    )
    await asyncio.sleep(max(begin + later - time.monotonic(), 0.0))
    for word in ("status", "preflight"):
        findings.refusals.append(await _refusal_of_mkctl(word, begin))


async def _refusal_of_mkctl(word: str, begin: float) -> Refusal:
    at = time.monotonic()
    asked = await Member.start(*MKCTL, "--vehicle", CUT, "--connect", ENDPOINT, word)
    code, said = await asked.output()
    said += asked.errors
    name = f"mkctl --vehicle {CUT} {word}"
    return Refusal(name, at - begin, time.monotonic() - at, said.strip(), code != 0, is_program=True)


async def _refusal(asked: str, call: Awaitable[Any], begin: float, findings: CutFindings) -> None:
    at = time.monotonic()
    try:
        words, is_refused = str(await call), False
    except MkError as error:
        words, is_refused = str(error), True
    findings.refusals.append(Refusal(asked, at - begin, time.monotonic() - at, words, is_refused))


def _read_black_box(files: list[Path], begin: float, end: float, findings: CutFindings) -> None:
    """What the aircraft recorded itself: its values through the gap, setpoints that came, the release on its wire."""
    values: list[float] = []
    setpoints: list[float] = []
    releases: list[float] = []
    for entry in (entry for path in files for entry in Recording(path).entries()):
        if entry.kind is EntryKind.SAMPLE and entry.suffix == WATCHED:
            values.append(entry.received)
        elif entry.kind is EntryKind.SETPOINT and entry.received < end:
            setpoints.append(entry.received)
        elif entry.kind is EntryKind.PORT_WRITTEN and entry.issuer == "release" and entry.received > begin:
            releases.append(entry.received)
        elif entry.suffix == "event/failsafe" and entry.kind is EntryKind.SAMPLE and begin < entry.received < end:
            event = unpacked(entry.payload)
            if event.get("action") == "release" and not findings.reason:
                findings.reason = str(event.get("reason"))
    findings.aboard = sum(begin < at < end for at in values)
    findings.aboard_gap = longest_gap(values, begin, end)
    if setpoints:
        findings.last_setpoint = setpoints[-1] - begin
        after = [at for at in releases if at > setpoints[-1]]
        findings.released = after[0] - setpoints[-1] if after else None


def _read_ground(files: list[Path], findings: CutFindings) -> None:
    """What the recorder on the ground has."""
    key = f"{ROOT}/{CUT}/{WATCHED}"
    for path in files:
        summary = summarise(path)
        if (found := summary.keys.get((EntryKind.SAMPLE, key))) is not None:
            findings.ground_gap = max(findings.ground_gap, found.longest_gap)
        for one, lost in summary.missed.items():
            if one.startswith(f"{ROOT}/{CUT}/"):
                findings.ground_lost += lost
            else:
                findings.others_lost += lost
