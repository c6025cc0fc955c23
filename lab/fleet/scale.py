"""`python -m lab fleet --case scale`: many simulated aircraft on one machine, a router between them and one client.

The client subscribes to everything, and counts. Each daemon says once a second how many values it has put, so what did
not arrive is known; each value says when it was put, and the clock is the same.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack, ExitStack, suppress
from pathlib import Path
from typing import Final

import zenoh

from lab.campaign import Row
from lab.cases import percentile
from lab.fleet.members import RECEIVING, ROUTER, Aircraft, Member, say
from lab.rigs.processes import START
from lab.rigs.waiting import wait_until
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.names import ROOT
from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.record.countcheck import CountCheck
from mkdaemon.record.entry import unpacked

SETTLING: Final = 5.0
"""After the last aircraft is heard, before anything is counted [s]."""
STAMPED: Final = "state/attitude"
"""The key whose lateness is looked at: the most frequent of those that a client flies by."""
FLEET_VIEW: Final = ("health", "control/status", "state/battery", "state/position")
"""Keys of `mkctl top --all`, counted as one group."""
EACH: Final = 60.0
"""Longer start for each aircraft on a machine that is busy [s]."""


class Counted:
    """What one client received.

    Attributes:
        sizes: of keys and payloads, by group of keys, the first word of a key [bytes].
        late: of each value of `STAMPED`, from being put to being received [s].
    """

    def __init__(self) -> None:
        self.sizes = Counter[str]()
        self.late: list[float] = []
        self._values = self._fleet_size = 0
        self._dropped: defaultdict[str, list[int]] = defaultdict(list)
        self._checks: defaultdict[str, CountCheck] = defaultdict(CountCheck)

    def take(self, key: str, payload: bytes, wall: float) -> None:
        """Take a value of a key at a time [s; Unix time]."""
        vehicle, _, suffix = key.partition("/")[2].partition("/")
        size = len(key) + len(payload)
        self._values += 1
        self.sizes[suffix.partition("/")[0]] += size
        self._fleet_size += size * (suffix in FLEET_VIEW)
        self._checks[vehicle].take(suffix, payload)
        if suffix == STAMPED:
            self.late.append(wall - float(unpacked(payload)["stamp"]["wall"]))
        elif suffix == "link/traffic":
            self._dropped[vehicle].append(sum(unpacked(payload)["dropped"].values()))

    def figures(self, count: int, seconds: float) -> Row:
        """What was received of so many aircraft in a time [s].

        Returns:
            Values a second, and how many were lost on the bus; frames that their lines lost; kB/s of each aircraft, of
            everything, by group and for the fleet view; quantiles of how late values were [ms].
        """
        late = sorted(round(1000 * one, 2) for one in self.late)
        lost = sum(check.lost.total() for check in self._checks.values())

        def each(size: float) -> float:
            return round(size / seconds / count / 1000, 2)

        return {
            "values_per_s": round(self._values / seconds, 1),
            "kb_per_s_each": each(self.sizes.total()),
            "fleet_view_kb_per_s_each": each(self._fleet_size),
            "groups_kb_per_s_each": {group: each(size) for group, size in self.sizes.most_common()},
            "lost_percent": round(100 * lost / (self._values + lost), 3) if self._values + lost else None,
            "line_lost": sum(reports[-1] - reports[0] for reports in self._dropped.values()),
            **{
                f"late_{name}_ms": percentile(late, share)
                for name, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
            },
        }


async def measure(count: int, seconds: float, folder: Path) -> Row:
    """Run so many aircraft and count for some time; returns a row of results.

    Raises:
        TimeoutError: an aircraft was not heard in time.
    """
    async with AsyncExitStack() as stack:
        endpoint = stack.enter_context(reserved_endpoint())
        router = await Member.start(*ROUTER, endpoint, threads=RECEIVING)
        stack.push_async_callback(router.end)
        await router.first_line()
        fleet: list[Aircraft] = []
        stack.push_async_callback(_end, fleet)
        with ExitStack() as ports:
            for number in range(1, count + 1):
                port = int(ports.enter_context(reserved_endpoint()).rpartition(":")[2])
                fleet.append(
                    await Aircraft.start(f"mk{number}", folder / f"mk{number}", port, router=endpoint, listen=[])
                )
        session = await open_session(session_config("client", connect=[endpoint]))
        stack.push_async_callback(close_session, session)
        say(f"{count} aircraft are started")
        await _wait_for_all(session, {one.folder.name for one in fleet}, START + EACH * count)
        await asyncio.sleep(SETTLING)
        row = {"vehicles": count} | await _counted(session, router, fleet, seconds)
        say(f"{count} aircraft: {row['values_per_s']:.0f} values a second, {row['lost_percent']} % lost")
        return row


async def _end(fleet: Sequence[Aircraft]) -> None:
    await asyncio.gather(*(one.end() for one in fleet))


async def _wait_for_all(session: zenoh.Session, names: set[str], patience: float) -> None:
    """Return when every aircraft's boards are heard."""
    alive: set[str] = set()

    def heard(sample: zenoh.Sample) -> None:
        if unpacked(sample.payload.to_bytes()).get("is_alive"):
            alive.add(str(sample.key_expr).split("/")[1])

    with session.declare_subscriber(f"{ROOT}/*/health", zenoh.handlers.Callback(heard, indirect=False)):
        await wait_until(lambda: names <= alive, patience, 0.1)


async def _counted(session: zenoh.Session, router: Member, fleet: Sequence[Aircraft], seconds: float) -> Row:
    """What the client receives in a time [s], and what the programs use meanwhile: percent of a core, and MiB."""
    counted, count = Counted(), len(fleet)

    def arrived(sample: zenoh.Sample) -> None:
        counted.take(str(sample.key_expr), sample.payload.to_bytes(), time.time())

    looks: dict[str, Callable[[], float]] = {
        "daemon_cpu_percent": lambda: sum(one.daemon.cpu_s() for one in fleet) / count,
        "simulator_cpu_percent": lambda: sum(one.simulator.cpu_s() for one in fleet) / count,
        "router_cpu_percent": router.cpu_s,
    }
    begin, before = time.monotonic(), {name: look() for name, look in looks.items()}
    with session.declare_subscriber(f"{ROOT}/**", zenoh.handlers.Callback(arrived, indirect=False)):
        await asyncio.sleep(seconds)
    took = time.monotonic() - begin
    used = {name: round(100 * (look() - before[name]) / took, 1) for name, look in looks.items()}
    daemon = sum(one.daemon.own_mb() for one in fleet) / count
    memory = {"daemon_mb": round(daemon, 1), "router_mb": round(router.own_mb(), 1)}
    return used | memory | counted.figures(count, took)


async def scale(counts: Sequence[int], seconds: float, folder: Path) -> list[Row]:
    """Measure each number of aircraft; one that does not come up ends the row of numbers."""
    rows: list[Row] = []
    for count in counts:
        (place := folder / str(count)).mkdir()
        with suppress(TimeoutError):
            rows.append(await measure(count, seconds, place))
            continue
        say(f"{count} aircraft do not come up on this machine")
        break
    return rows
