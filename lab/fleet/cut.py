"""`python -m lab fleet --case cut`: three aircraft, each in a network of its own; the link of one is lossy, and is cut.

Ground: a Zenoh router, `mkctl log record`, the fleet view, and a client that flies the second aircraft by sticks. Every
process reads the same monotonic clock, so times of the recordings and of the ground compare.
"""

from __future__ import annotations

import asyncio
import signal
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from lab.campaign import Row
from lab.fleet.members import RECEIVING, ROUTER, Aircraft, Member, say
from lab.fleet.network import DELAY, LOSS, Place, RadioLink
from lab.rigs.processes import MKCTL, START, wait_for_control
from lab.rigs.waiting import running, wait_until
from mkdaemon.bus.names import ROOT
from mkdaemon.client import Vehicle, connect
from mkdaemon.client.fleet import Fleet
from mkdaemon.errors import MkError
from mkdaemon.reading.known import SIGN_OF_LIFE
from mkdaemon.record.entry import EntryKind, unpacked
from mkdaemon.record.reader import Recording
from mkdaemon.record.summary import summarise
from mkdaemon.view.top.fleetboard import KEYS, FleetBoard

TOLD: Final = 1.0
"""The fleet view says `stale` so long after its own limit at the latest [s]."""
GONE: Final = 4.0
"""A daemon that is cut off has gone from the router's list after so long [s]: its bus lease of 2 s, and the machine."""
REFUSED: Final = 4.0
"""Longest wait of a program that asks an aircraft that is cut off [s]."""
RELEASED: Final = (0.9, 2.0)
"""From the last setpoint that came through to the release on the wire [s]: 1.0 s by docs/safety.md."""
HEALED: Final = 10.0
"""Longest time from the link's return to fresh telemetry [s]."""
UNTOUCHED: Final = 2.0
"""Longest time without a value of the others [s]: `health` comes every second."""
ABOARD: Final = 1.5
"""The same of the black box aboard, through the cut [s]."""
NOT_CUT: Final = 0.5
"""A recording on the ground has a gap of the cut's length, less so much [s]."""


def claims(found: Mapping[str, Any]) -> dict[str, bool]:
    """What must be so after a cut, in words, and whether it is.

    Args:
        found: times from the cut, or from the link's return [s], None for never: `told_stale`, `told_gone` and
            `told_back` by the fleet view, `fresh` telemetry, `leased_again`, `client_told` that its lease is lost,
            `last_setpoint` that reached the aircraft, and `released`, on its wire, from that setpoint on. `others`,
            what the view said of them, `others_gap`, longest time without a value of theirs [s], `others_lost`, values.
            `refusals`, rows of what was asked while it was cut off. `aboard`, values in the black box in the cut, and
            `aboard_gap`; `ground_gap` of the same key on the ground, and `ground_lost`. `cut_for` [s]; `exit_codes` of
            the daemons.
    """
    least, most = RELEASED
    untouched = (found["others"], found["others_lost"]) == (["here"], 0) and found["others_gap"] <= UNTOUCHED
    is_gone = _within(found["told_gone"], GONE)
    return {
        "the fleet view says stale": _within(found["told_stale"], SIGN_OF_LIFE + TOLD) or is_gone,
        "the fleet view says gone": is_gone,
        "the others are untouched": untouched,
        "commands refuse clearly": bool(found["refusals"]) and all(map(is_clear, found["refusals"])),
        "the daemon releases": found["released"] is not None and least <= found["released"] <= most,
        "its client is told": found["client_told"] is not None,
        "telemetry heals": _within(found["fresh"], HEALED) and _within(found["told_back"], HEALED),
        "the lease can be taken again": found["leased_again"] is not None,
        "the black box has the gap": found["aboard"] > 0 and found["aboard_gap"] <= ABOARD,
        "the ground's recording names it": found["ground_gap"] >= found["cut_for"] - NOT_CUT
        and found["ground_lost"] > 0,
        "daemons end in order": bool(found["exit_codes"]) and not any(found["exit_codes"]),
    }


def is_clear(refusal: Mapping[str, Any]) -> bool:
    """Whether what was `asked` ended in time, with one line that names the aircraft and what to look at.

    Args:
        refusal: `took` until it ended [s], the `words` of it, `is_refused`, `is_program`: with its start, which is the
            machine's.
    """
    has_words = "does not reach vehicle" in refusal["words"] and "\n" not in refusal["words"].strip()
    return refusal["is_refused"] and has_words and (refusal["is_program"] or refusal["took"] <= REFUSED)


def _within(time: float | None, limit: float) -> bool:
    return time is not None and time <= limit


def longest_gap(times: Sequence[float], begin: float, end: float) -> float:
    """Longest time without a value from a begin to an end [s]; values before and behind count as the edges' own."""
    inside = [begin, *(at for at in times if begin < at < end), end]
    return max(later - sooner for sooner, later in pairwise(inside))


NAMES: Final = ("mk1", "mk2", "mk3")
WATCHED: Final = "state/battery"
"""The key whose gaps are looked at: it comes with every set of the NaviCtrl's data."""
LOOK: Final = 0.02
"""Between two looks at the fleet view [s]."""


class Watcher:
    """Looks at the fleet view for as long as it runs.

    Attributes:
        times: when a value of `WATCHED` came from a vehicle [s; monotonic].
        heard: when anything came from it.
        said: every change of what the view says of a vehicle, as (time, state).
    """

    def __init__(self, client: Vehicle) -> None:
        self._board = FleetBoard()
        self.times: defaultdict[str, list[float]] = defaultdict(list)
        self.heard: defaultdict[str, list[float]] = defaultdict(list)
        self.said: defaultdict[str, list[tuple[float, str]]] = defaultdict(list)
        self._fleet = Fleet(client)

    async def run(self) -> None:
        """Watch, for ever."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._take(), name="values")
            tasks.create_task(self._look(), name="looks")

    async def _take(self) -> None:
        def changed() -> None:
            self._board.look(self._fleet.vehicles, time.monotonic())

        async with self._fleet.watch(changed, lambda *_: None), self._fleet.values(*KEYS) as samples:
            async for sample in samples:
                name, _, suffix = sample.suffix.partition("/")
                now = time.monotonic()
                self._board.take(name, suffix, sample.known, now)
                self.heard[name].append(now)
                if suffix == WATCHED:
                    self.times[name].append(now)

    async def _look(self) -> None:
        while True:
            now = time.monotonic()
            for name in NAMES:
                state, said = self._board.state(name, now), self.said[name]
                if not said or said[-1][1] != state:
                    said.append((now, state))
            await asyncio.sleep(LOOK)

    def state(self, name: str) -> str:
        """What it says of a vehicle now."""
        return self.said[name][-1][1] if self.said[name] else "unknown"

    def first(self, name: str, state: str, since: float) -> float | None:
        """How long after a time it first said so [s]; None for never."""
        return next((at - since for at, said in self.said[name] if at >= since and said == state), None)

    def between(self, name: str, begin: float, end: float) -> set[str]:
        """Everything it said of a vehicle in some time."""
        before = [said for at, said in self.said[name] if at < begin]
        return {*before[-1:], *(said for at, said in self.said[name] if begin <= at < end)}


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
    """Cut the link of one aircraft for some time [s], and look: what was seen, see `claims`, and `claims` of it.

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
