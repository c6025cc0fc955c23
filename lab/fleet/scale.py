"""`python -m lab fleet --case scale`: many simulated aircraft on one machine, a router between them and one client.

The client subscribes to everything, and counts. Each daemon says once a second how many values it has put, so what did
not arrive is known; each value says when it was put, and the clock is the same.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import zenoh

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


@dataclass
class Counted:
    """What one client received.

    Attributes:
        values: how many, by group of keys: the first word of a key.
        sizes: bytes of keys and payloads, by group.
        fleet_sizes: bytes of those that the fleet view wants.
        late: of each value of `STAMPED`, from being put to being received [s].
        line: by vehicle, frames and losses on its line at the first and the last report in the time counted.
    """

    values: Counter[str] = field(default_factory=Counter)
    sizes: Counter[str] = field(default_factory=Counter)
    fleet_sizes: int = 0
    late: list[float] = field(default_factory=list)
    line: defaultdict[str, list[tuple[int, int]]] = field(default_factory=lambda: defaultdict(list))
    _checks: dict[str, CountCheck] = field(default_factory=dict)

    def take(self, key: str, payload: bytes, wall: float) -> None:
        """Take a value of a key at a time [s; Unix time]."""
        vehicle, _, suffix = key.partition("/")[2].partition("/")
        group = suffix.partition("/")[0]
        self.values[group] += 1
        self.sizes[group] += len(key) + len(payload)
        if suffix in FLEET_VIEW:
            self.fleet_sizes += len(key) + len(payload)
        self._checks.setdefault(vehicle, CountCheck()).take(suffix, payload)
        if suffix == STAMPED:
            self.late.append(wall - float(unpacked(payload)["stamp"]["wall"]))
        elif suffix == "link/traffic":
            fields = unpacked(payload)
            self.line[vehicle].append((int(fields["rx_frames"]), sum(fields["dropped"].values())))

    def losses(self) -> Counter[str]:
        """Values that did not come, by vehicle."""
        return Counter({name: check.lost.total() for name, check in self._checks.items()})


def figures(
    count: int, seconds: float, counted: Counted, used: Mapping[str, float], memory: Mapping[str, float]
) -> dict[str, Any]:
    """A row of results.

    Args:
        count: of aircraft.
        seconds: that were counted.
        counted: what the client received.
        used: processor time of daemons, simulators, router and client [s].
        memory: of a daemon and of a simulator, means, and of the router [MiB].
    """
    late = sorted(round(1000 * one, 2) for one in counted.late)
    total = counted.values.total()
    spans = [reports for reports in counted.line.values() if len(reports) > 1]
    frames = sum(last[0] - first[0] for first, *_, last in spans)
    dropped = sum(last[1] - first[1] for first, *_, last in spans)
    lost = counted.losses().total()
    return {
        "vehicles": count,
        "heard": len(counted.line),
        "seconds": round(seconds, 1),
        "daemon_cpu_percent": round(100 * used["daemons"] / seconds / count, 1),
        "simulator_cpu_percent": round(100 * used["simulators"] / seconds / count, 1),
        "router_cpu_percent": round(100 * used["router"] / seconds, 1),
        "client_cpu_percent": round(100 * used["client"] / seconds, 1),
        "daemon_mb": round(memory["daemon"], 1),
        "simulator_mb": round(memory["simulator"], 1),
        "router_mb": round(memory["router"], 1),
        "values_per_s": round(total / seconds, 1),
        "kb_per_s_each": round(counted.sizes.total() / seconds / count / 1000, 2),
        "fleet_view_kb_per_s_each": round(counted.fleet_sizes / seconds / count / 1000, 2),
        "groups_kb_per_s_each": {
            group: round(size / seconds / count / 1000, 2) for group, size in counted.sizes.most_common()
        },
        "lost_values": lost,
        "lost_percent": round(100 * lost / (total + lost), 3) if total + lost else None,
        "line_frames": frames,
        "line_lost": dropped,
        **{f"late_{name}_ms": percentile(late, share) for name, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))},
    }


async def measure(count: int, seconds: float, folder: Path) -> dict[str, Any]:
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
        await _wait_for_all(session, {one.name for one in fleet}, START + EACH * count)
        await asyncio.sleep(SETTLING)
        row = await _counted(session, router, fleet, seconds)
        say(f"{count} aircraft: {row['values_per_s']:.0f} values a second, {row['lost_values']} lost")
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


async def _counted(session: zenoh.Session, router: Member, fleet: Sequence[Aircraft], seconds: float) -> dict[str, Any]:
    counted = Counted()

    def arrived(sample: zenoh.Sample) -> None:
        counted.take(str(sample.key_expr), sample.payload.to_bytes(), time.time())

    looks: dict[str, Callable[[], float]] = {
        "daemons": lambda: sum(one.daemon.cpu_s() for one in fleet),
        "simulators": lambda: sum(one.simulator.cpu_s() for one in fleet),
        "router": router.cpu_s,
        "client": lambda: sum(os.times()[:2]),
    }
    begin, before = time.monotonic(), {name: look() for name, look in looks.items()}
    with session.declare_subscriber(f"{ROOT}/**", zenoh.handlers.Callback(arrived, indirect=False)):
        await asyncio.sleep(seconds)
    took = time.monotonic() - begin
    used = {name: look() - before[name] for name, look in looks.items()}
    memory = {
        "daemon": sum(one.daemon.own_mb() for one in fleet) / len(fleet),
        "simulator": sum(one.simulator.own_mb() for one in fleet) / len(fleet),
        "router": router.own_mb(),
    }
    return figures(len(fleet), took, counted, used, memory)


async def scale(counts: Sequence[int], seconds: float, folder: Path) -> list[dict[str, Any]]:
    """Measure each number of aircraft; one that does not come up ends the row of numbers."""
    rows: list[dict[str, Any]] = []
    for count in counts:
        (place := folder / str(count)).mkdir()
        with suppress(TimeoutError):
            rows.append(await measure(count, seconds, place))
            continue
        say(f"{count} aircraft do not come up on this machine")
        break
    return rows
