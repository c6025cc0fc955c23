"""`python -m lab fleet --case cut`: three aircraft, each in a network of its own; the link of one is lossy, and is cut.

Ground: a Zenoh router, `mkctl log record`, the fleet view, and a client that flies the second aircraft by sticks. Every
process reads the same monotonic clock, so times of the recordings and of the ground compare.
"""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import AsyncIterator, Coroutine, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

from lab.campaign import Row
from lab.fleet.findings import claims, longest_gap
from lab.fleet.members import RECEIVING, ROUTER, Aircraft, Member, say
from lab.fleet.network import Place
from lab.fleet.radio import DELAY, LOSS, RadioLink
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
async def fleet(folder: Path) -> AsyncIterator[tuple[dict[str, Aircraft], RadioLink]]:
    """Three aircraft and a router while the context lasts; this process stands on the ground."""
    async with AsyncExitStack() as stack:
        places: dict[str, Place] = {}
        for number, name in enumerate(NAMES, 1):
            places[name] = Place(number, is_radio=name == CUT)
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
        radio = places[CUT].radio
        assert radio is not None
        yield aircraft, radio


async def cut(folder: Path, seconds: float) -> Row:
    """Cut the link of one aircraft for some time, and look.

    Args:
        folder: of all files.
        seconds: length of the cut.

    Returns:
        What was seen, see `claims`, and `claims` of it.

    Raises:
        ConfigError: network namespaces or devices are not permitted here.
        TimeoutError: the fleet did not come up.
    """
    async with fleet(folder) as (aircraft, radio), connect(CUT, ENDPOINT) as client:
        recorder = await Member.start(
            *MKCTL, "log", "record", "--folder", str(folder / "ground"), "--connect", ENDPOINT
        )
        watcher = Watcher(client)
        say("the router and three aircraft are started")
        try:
            async with running(watcher.run()):
                await wait_until(lambda: all(watcher.state(name) == "here" for name in NAMES), START)
                await wait_for_control(client, START)
                found, begin, end = await _through_the_cut(client, watcher, radio, seconds)
        finally:
            say("ending")
            await recorder.end(signal.SIGINT)
        exit_codes = [await one.end() for one in aircraft.values()]
    found |= {"loss": LOSS, "delay": DELAY, "exit_codes": exit_codes}
    found |= _black_box(aircraft[CUT].recordings, begin, end) | _ground(sorted((folder / "ground").glob("*.mcap")))
    return found | {"claims": claims(found), "holds": all(claims(found).values())}


async def _through_the_cut(
    client: Vehicle, watcher: Watcher, radio: RadioLink, seconds: float
) -> tuple[Row, float, float]:
    """Before, while and after: what was seen, when the link was cut and when it came back [s; monotonic]."""
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
    radio.is_cut = True
    begin = time.monotonic()
    say(f"the link of {CUT} is cut")
    asking = asyncio.create_task(_ask(client, begin), name="asking")
    await asyncio.sleep(seconds)
    refusals = await asking
    radio.is_cut = False
    end = time.monotonic()
    say("it is back")
    with suppress(TimeoutError):
        await wait_until(lambda: watcher.times[CUT][-1] > end and watcher.state(CUT) == "here", PATIENCE)
    say(f"{CUT} is {watcher.state(CUT)}")
    lost_at, words = await flying
    say(f"its client: {words}")
    leased_again = await _take_again(client, end)
    await asyncio.sleep(AFTER)
    others = [name for name in NAMES if name != CUT]
    seen = set[str]().union(*(watcher.between(name, begin, time.monotonic()) for name in others))
    found: Row = {
        "cut_for": round(end - begin, 2),
        "told_stale": watcher.first(CUT, "stale", begin),
        "told_gone": watcher.first(CUT, "gone", begin),
        "told_back": watcher.first(CUT, "here", end),
        "fresh": next((at - end for at in watcher.times[CUT] if at > end), None),
        "leased_again": leased_again,
        "others": sorted(seen),
        "others_gap": max(longest_gap(watcher.heard[name], begin, end) for name in others),
        "refusals": refusals,
        "client_told": lost_at - begin,
        "client_words": words,
    }
    return found, begin, end


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


async def _take_again(client: Vehicle, since: float) -> float | None:
    """How long after a moment the lease was granted again [s]; None for never."""
    while time.monotonic() - since < PATIENCE:
        with suppress(MkError):
            async with client.lease():
                return time.monotonic() - since
        await asyncio.sleep(0.2)
    return None


async def _ask(client: Vehicle, begin: float) -> list[Row]:
    """Ask the aircraft that is cut off: from a program, and by `mkctl`."""
    first, later = MOMENTS
    await asyncio.sleep(max(begin + first - time.monotonic(), 0.0))
    calls = {"status": client.status(), "preflight": client.preflight()}
    asked = (_asked(f"{word}, of a program", _answered(call)) for word, call in calls.items())
    found: list[Row] = list(await asyncio.gather(*asked))
    await asyncio.sleep(max(begin + later - time.monotonic(), 0.0))
    for word in ("status", "preflight"):
        words = ("--vehicle", CUT, "--connect", ENDPOINT, word)
        found.append(await _asked(f"mkctl --vehicle {CUT} {word}", _answered_by_mkctl(words), is_program=True))
    return found


async def _asked(what: str, call: Coroutine[Any, Any, tuple[str, bool]], *, is_program: bool = False) -> Row:
    at = time.monotonic()
    words, is_refused = await call
    row = {"asked": what, "took": time.monotonic() - at, "words": words}
    return row | {"is_refused": is_refused, "is_program": is_program}


async def _answered(call: Coroutine[Any, Any, Any]) -> tuple[str, bool]:
    try:
        return str(await call), False
    except MkError as error:
        return str(error), True


async def _answered_by_mkctl(words: Sequence[str]) -> tuple[str, bool]:
    asked = await Member.start(*MKCTL, *words)
    code, said = await asked.output()
    return (said + asked.errors).strip(), code != 0


def _black_box(files: list[Path], begin: float, end: float) -> Row:
    """What the aircraft recorded itself: its values through the gap, setpoints that came, the release on its wire."""
    values, setpoints, releases, reasons = list[float](), list[float](), list[float](), list[str]()
    for entry in (entry for path in files for entry in Recording(path).entries()):
        if entry.kind is EntryKind.SAMPLE and entry.suffix == WATCHED:
            values.append(entry.received)
        elif entry.kind is EntryKind.SETPOINT and entry.received < end:
            setpoints.append(entry.received)
        elif entry.kind is EntryKind.PORT_WRITTEN and entry.issuer == "release" and entry.received > begin:
            releases.append(entry.received)
        elif entry.suffix == "event/failsafe" and entry.kind is EntryKind.SAMPLE and begin < entry.received < end:
            event = unpacked(entry.payload)
            reasons += [str(event.get("reason"))] if event.get("action") == "release" else []
    last = setpoints[-1] if setpoints else None
    return {
        "aboard": sum(begin < at < end for at in values),
        "aboard_gap": longest_gap(values, begin, end),
        "last_setpoint": None if last is None else last - begin,
        "released": None if last is None else next((at - last for at in releases if at > last), None),
        "reason": reasons[0] if reasons else "",
    }


def _ground(files: list[Path]) -> Row:
    """What the recorder on the ground has."""
    found: Row = {"ground_gap": 0.0, "ground_lost": 0, "others_lost": 0}
    for path in files:
        summary = summarise(path)
        if (known := summary.keys.get((EntryKind.SAMPLE, f"{ROOT}/{CUT}/{WATCHED}"))) is not None:
            found["ground_gap"] = max(found["ground_gap"], known.longest_gap)
        for key, lost in summary.missed.items():
            found["ground_lost" if key.startswith(f"{ROOT}/{CUT}/") else "others_lost"] += lost
    return found
