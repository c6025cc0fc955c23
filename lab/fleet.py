"""`python -m lab fleet`: three aircraft on a router; the link of one, which a client flies, is cut and comes back.

Simulators, daemons, router, `mkctl log record` and `mkctl` are processes; this one has the fleet view and the pilot,
and carries what the second daemon and the router exchange. Every process reads the same monotonic clock, so times of
the recordings and of the ground compare.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.campaign import Row
from lab.cases import judged, silence_log
from lab.rigs.processes import MKCTL, PROGRAM, START, Program, wait_for_control
from lab.rigs.router import ROUTER
from lab.rigs.waiting import running, wait_until
from lab.tables import show
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.names import ROOT
from mkdaemon.cli.arguments import AsJson, Length
from mkdaemon.client import Vehicle, connect
from mkdaemon.client.fleet import Fleet
from mkdaemon.errors import MkError
from mkdaemon.record.entry import EntryKind, unpacked
from mkdaemon.record.reader import Recording
from mkdaemon.record.summary import summarise
from mkdaemon.view.top.fleetboard import KEYS, FleetBoard

LIMITS: Final[dict[str, float | str]] = {
    "told_gone": 4.0,  # the bus lease of 2 s, and the machine
    "others_gap": 2.0,  # `health` comes every second
    "others_lost": 0,
    "others_worse": 0,
    "unclear": 0,
    "released": 2.0,  # 1.0 s by docs/safety.md
    "flown_late": 0,
    "client_told": 10.0,
    "fresh": 10.0,
    "told_back": 10.0,
    "leased_again": 30.0,
    "aboard_gap": 1.5,
    "ground_short": 0.5,
    "is_unnamed": False,
    "exit_code": 0,
}
"""See `cut`."""
REFUSED: Final = 15.0
"""Longest wait for the end of `mkctl` that asks an aircraft that is cut off, on a busy machine [s]."""


def is_clear(refusal: Mapping[str, Any]) -> bool:
    """Whether what was `asked` ended in time, with one line that names the aircraft and what to look at.

    Args:
        refusal: `took` until it ended, with its start, which is the machine's [s], the `words` of it, `is_refused`.
    """
    has_words = "does not reach vehicle" in refusal["words"] and "\n" not in refusal["words"].strip()
    return refusal["is_refused"] and has_words and refusal["took"] <= REFUSED


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
"""The one whose link is cut."""
DELAY: Final = 0.03
"""Of its link, each way [s]."""
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


class RadioLink:
    """Carries bytes to the router, later; while it is cut nothing passes, and neither end notices.

    Attributes:
        is_whole: cleared while it is cut. What was under way arrives late, as over any link that sends again.
    """

    def __init__(self, router: str) -> None:
        self.is_whole = asyncio.Event()
        self.is_whole.set()
        self._router = router

    async def carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry one connection until an end closes it."""
        host, _, port = self._router.removeprefix("tcp/").partition(":")
        onward, back = await asyncio.open_connection(host, int(port))
        await asyncio.gather(self._pass_on(reader, back), self._pass_on(onward, writer))

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            while chunk := await reader.read(1 << 16):
                await asyncio.sleep(DELAY)
                await self.is_whole.wait()
                writer.write(chunk)
                await writer.drain()
        await self.is_whole.wait()
        writer.close()


@asynccontextmanager
async def fleet(folder: Path, endpoint: str) -> AsyncIterator[tuple[dict[str, Program], RadioLink]]:
    """Three daemons before simulated boards, and a router at an endpoint, while the context lasts."""
    async with AsyncExitStack() as stack:
        router = await Program.start(*ROUTER, endpoint, threads="(rx: (worker_threads: 32))")  # docs/operations.md
        stack.push_async_callback(router.end)
        await router.first_line()
        radio = RadioLink(endpoint)
        relay = await asyncio.start_server(radio.carry, "127.0.0.1", 0)
        stack.callback(relay.close)
        far = f"tcp/127.0.0.1:{relay.sockets[0].getsockname()[1]}"
        daemons: dict[str, Program] = {}
        for name in NAMES:
            boards = stack.enter_context(reserved_endpoint()).removeprefix("tcp/")
            (place := folder / name).mkdir()
            (place / "sim.toml").write_text("[sim]\nconnect = []\n", encoding="utf-8")
            (place / "daemon.toml").write_text(
                f'[vehicle]\nname = "{name}"\nstate_folder = "{place}/state"\n[link]\nport = "tcp:{boards}"\n'
                f'[bus]\nlisten = []\nconnect = ["{far if name == CUT else endpoint}"]\n',
                encoding="utf-8",
            )
            sim = ("sim", "--config", f"{place}/sim.toml", "--pilot", "nothing", "--vehicle", name, "--listen", boards)
            simulator = await Program.start(*PROGRAM, *sim)
            stack.push_async_callback(simulator.end, signal.SIGINT)
            await simulator.first_line()
            daemons[name] = await Program.start(*PROGRAM, "run", "--config", f"{place}/daemon.toml", "--log", "warning")
            stack.push_async_callback(daemons[name].end)
        yield daemons, radio


async def cut(folder: Path, seconds: float) -> Row:
    """Cut the link of one aircraft for some time [s], and look.

    Returns:
        Times from the cut, or from the link's return [s], None for never: `told_gone` and `told_back` by the fleet
        view, `fresh` telemetry, `leased_again`, `client_told` that its lease is lost, `last_setpoint` that reached the
        aircraft, and `released`, on its wire, from that setpoint on; `flown_late`, stick frames after that release,
        though late setpoints arrive when the link is back. Of the other aircraft `others_gap`, longest time without a
        value [s], `others_lost`, values, `others_worse`, what the view said of them but `here`. `unclear`, commands to
        the aircraft that were not refused clearly. `aboard_gap` of a key in the black box through the cut [s];
        `ground_short`, by how much the gap on the ground is shorter than the cut [s], and `is_unnamed`: the recording
        does not know that values are missing. `exit_code` of the daemons.

    Raises:
        TimeoutError: the fleet did not come up.
    """
    with reserved_endpoint() as endpoint:
        async with fleet(folder, endpoint) as (daemons, radio), connect(CUT, endpoint) as client:
            words = ("log", "record", "--folder", str(folder / "ground"), "--connect", endpoint)
            recorder = await Program.start(*MKCTL, *words)
            watcher = Watcher(client)
            try:
                async with running(watcher.run()):
                    await wait_until(lambda: all(watcher.state(name) == "here" for name in NAMES), START)
                    await wait_for_control(client, START)
                    found, begin, end = await _through_the_cut(client, endpoint, watcher, radio, seconds)
            finally:
                await recorder.end(signal.SIGINT)
            found["exit_code"] = sum([abs(await one.end()) for one in daemons.values()])
    found |= _black_box(sorted((folder / CUT).glob("state/**/*.mcap")), begin, end)
    found |= _ground(sorted((folder / "ground").glob("*.mcap")))
    found["ground_short"] = round(end - begin - found.pop("ground_gap"), 2)
    return judged(LIMITS, **found)


def _say(words: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {words}", file=sys.stderr, flush=True)


async def _through_the_cut(
    client: Vehicle, endpoint: str, watcher: Watcher, radio: RadioLink, seconds: float
) -> tuple[Row, float, float]:
    """Before, while and after: what was seen, when the link was cut and when it came back [s; monotonic]."""
    _say("all are here")
    await asyncio.sleep(BEFORE)
    engaged = asyncio.Event()
    flying = asyncio.create_task(_fly(client, engaged), name="pilot")
    try:
        async with asyncio.timeout(START):
            await engaged.wait()
    except TimeoutError:
        flying.cancel()
        raise
    await asyncio.sleep(FLOWN)
    radio.is_whole.clear()
    begin = time.monotonic()
    _say(f"the link of {CUT} is cut")
    asking = asyncio.create_task(_ask(endpoint, begin), name="asking")
    await asyncio.sleep(seconds)
    refusals = await asking
    radio.is_whole.set()
    end = time.monotonic()
    _say("it is back")
    with suppress(TimeoutError):
        await wait_until(lambda: watcher.times[CUT][-1] > end and watcher.state(CUT) == "here", PATIENCE)
    lost_at, words = await flying
    leased_again = await _take_again(client, end)
    await asyncio.sleep(AFTER)
    others = [name for name in NAMES if name != CUT]
    seen = set[str]().union(*(watcher.between(name, begin, time.monotonic()) for name in others))
    found: Row = {
        "told_gone": watcher.first(CUT, "gone", begin),
        "told_back": watcher.first(CUT, "here", end),
        "fresh": next((at - end for at in watcher.times[CUT] if at > end), None),
        "leased_again": leased_again,
        "others_worse": len(seen - {"here"}),
        "others_gap": max(longest_gap(watcher.heard[name], begin, end) for name in others),
        "refusals": refusals,
        "unclear": sum(not is_clear(one) for one in refusals),
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
            _say(f"{CUT} is not flown: {error}")
        await asyncio.sleep(1.0)


async def _take_again(client: Vehicle, since: float) -> float | None:
    """How long after a moment the lease was granted again [s]; None for never."""
    while time.monotonic() - since < PATIENCE:
        with suppress(MkError):
            async with client.lease():
                return time.monotonic() - since
        await asyncio.sleep(0.2)
    return None


async def _ask(endpoint: str, begin: float) -> list[Row]:
    """Ask the aircraft that is cut off, at both moments."""
    found: list[Row] = []
    for moment in MOMENTS:
        await asyncio.sleep(max(begin + moment - time.monotonic(), 0.0))
        for word in ("status", "preflight"):
            asked, at = await Program.start(*MKCTL, "--vehicle", CUT, "--connect", endpoint, word), time.monotonic()
            code, said = await asked.output()
            row = {"asked": word, "took": time.monotonic() - at, "words": (said + asked.errors).strip()}
            found.append(row | {"is_refused": code != 0})
    return found


def _black_box(files: list[Path], begin: float, end: float) -> Row:
    """What the aircraft recorded itself: its values through the gap, setpoints that came, the release on its wire."""
    values, setpoints, releases, flown, reasons = *(list[float]() for _ in range(4)), list[str]()
    for entry in (entry for path in files for entry in Recording(path).entries()):
        if entry.kind is EntryKind.SAMPLE and entry.suffix == WATCHED:
            values.append(entry.received)
        elif entry.kind is EntryKind.SETPOINT and entry.received < end:
            setpoints.append(entry.received)
        elif entry.kind is EntryKind.PORT_WRITTEN and entry.issuer == "release" and entry.received > begin:
            releases.append(entry.received)
        elif entry.kind is EntryKind.PORT_WRITTEN and entry.issuer == "setpoint":
            flown.append(entry.received)
        elif entry.suffix == "event/failsafe" and entry.kind is EntryKind.SAMPLE and begin < entry.received < end:
            event = unpacked(entry.payload)
            reasons += [str(event.get("reason"))] if event.get("action") == "release" else []
    last = setpoints[-1] if setpoints else None
    return {
        "aboard_gap": longest_gap(values, begin, end),
        "last_setpoint": None if last is None else last - begin,
        "released": None if last is None else next((at - last for at in releases if at > last), None),
        "flown_late": sum(at > releases[0] for at in flown) if releases else 0,
        "reason": reasons[0] if reasons else "",
    }


def _ground(files: list[Path]) -> Row:
    """What the recorder on the ground has."""
    found: Row = {"ground_gap": 0.0, "is_unnamed": True, "others_lost": 0}
    for path in files:
        summary = summarise(path)
        if (known := summary.keys.get((EntryKind.SAMPLE, f"{ROOT}/{CUT}/{WATCHED}"))) is not None:
            found["ground_gap"] = max(found["ground_gap"], known.longest_gap)
        for key, lost in summary.missed.items():
            if not key.startswith(f"{ROOT}/{CUT}/"):
                found["others_lost"] += lost
            elif lost:
                found["is_unnamed"] = False
    return found


def main(
    *,
    seconds: Annotated[Length, Parameter(help="Length of the cut [s].")] = 12.0,
    as_json: AsJson = False,
) -> int:
    """Cut the link of one aircraft of three, two minutes; exit code 1 if a limit is broken.

    Raises:
        MkError: the machine is too busy for it.
    """
    silence_log()
    with tempfile.TemporaryDirectory() as name:
        try:
            row = asyncio.run(cut(Path(name), seconds))
        except TimeoutError:
            why = "the aircraft did not come up, or were not flown, in time: this machine is busy"
            raise MkError(why) from None
    return show([{"what": f"cut for {seconds:g} s", **row, "holds": not row["is_wrong"]}], ("what",), as_json=as_json)
