"""Programs that attack a daemon, each a process: `python -m lab.attack.attackers KIND ENDPOINT VEHICLE SECONDS`."""

from __future__ import annotations

import asyncio
import math
import os
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from itertools import cycle
from typing import Final

import msgpack
import zenoh

from mkdaemon.bus.keys import Use, roots
from mkdaemon.bus.session import session_config
from mkdaemon.client import connect
from mkdaemon.client.session import FlightSession

BEGINS: Final = "begins"
"""First line on standard output: everything is loaded and connected."""
BIG: Final = 10_000_000
"""Length of a big message [bytes]."""
LONG: Final = 900_000
"""Length of a long query [bytes]; Zenoh itself drops what is longer than 1 MiB."""
SILENT: Final = 1500
"""Connections that say nothing."""
STRANGER: Final = {"transport/shared_memory/enabled": True}
"""Settings of Zenoh's that a program of a stranger's has: those of its own."""
LINGER: Final = 60.0
"""How long a holder lives on in silence [s]."""
SLEEPERS: Final = 8
"""Subscribers that one process stops with it."""


class Flood(StrEnum):
    """What an attacker does."""

    SETPOINTS = "setpoints"
    """Setpoints without a lease, as many as go: in batches, dropped where they do not go at once, real-time."""
    READ = "setpoints beside a reader"
    """The same, while a session of the attacker's own subscribes to everything: then they leave the attacker."""
    BIG = "10 MB setpoints"
    COMMANDS = "commands"
    """`do/lease`, answers read."""
    TOKENS = "tokens"
    """Of clients that are none, shown and withdrawn."""
    REFUSALS = "unknown verbs"
    """`do/nothing`, each a refusal in the log."""
    LOOKUPS = "last values"
    """Of all keys."""
    UNREAD = "unread answers"
    """Schemas of all keys asked for, and no answer read."""
    LONG = "900 kB queries"
    """For schemas and last values, as many as go, no answer read."""
    SILENT = "silent connections"
    STOPPED = "stopped subscribers"
    """Subscribers of everything that are stopped by a signal of their own: they vanish without a word."""
    HOLDER = "the holder of the lease"
    """It flies, tilts, and puts setpoints, as many as go; then it says when the last one was, and falls silent."""


def main() -> None:
    """Attack for a time: standard output has a line when it begins, then how often a second."""
    kind, endpoint, vehicle, seconds = Flood(sys.argv[1]), sys.argv[2], sys.argv[3], float(sys.argv[4])
    if kind is Flood.SILENT:
        host, _, port = endpoint.removeprefix("tcp/").partition(":")
        sockets = [socket.create_connection((host, int(port))) for _ in range(SILENT)]
        print(BEGINS, flush=True)
        time.sleep(seconds)
        print(len(sockets), flush=True)
        return
    if kind is Flood.HOLDER:
        asyncio.run(_hold(endpoint, vehicle, seconds))
    session = zenoh.open(session_config("client", connect=[endpoint], more=STRANGER))
    if kind is Flood.STOPPED:
        sessions = [session, *(zenoh.open(session_config("client", connect=[endpoint])) for _ in range(SLEEPERS - 1))]
        for one in sessions:
            one.declare_subscriber(f"mk/{vehicle}/**", lambda sample: None)
        time.sleep(0.5)
        print(BEGINS, len(sessions), sep="\n", flush=True)
        os.kill(os.getpid(), signal.SIGSTOP)  # whoever started it ends it
    if kind is Flood.READ:
        reader = zenoh.open(session_config("client", connect=[endpoint]))
        reader.declare_subscriber("mk/**", zenoh.handlers.RingChannel(1))
        time.sleep(0.5)
    strike = _striker(kind, session, vehicle)
    print(BEGINS, flush=True)
    count, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        count += strike()
    with suppress(BrokenPipeError):
        print(round(count / seconds), flush=True)
    os._exit(0)  # what was not read must not hold up the end


async def _hold(endpoint: str, vehicle: str, seconds: float) -> None:
    """Flood as the holder, without a look at what the daemon says; whoever started it ends it."""
    tilted = {"pitch": 40.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}
    session = FlightSession(silence=math.inf)
    async with connect(vehicle, endpoint) as uav, uav.lease(session, holder="flood") as lease:
        await lease.stick(throttle=0.0, seconds=0.2)
        await lease.stick(throttle=0.0, pitch=tilted["pitch"], seconds=0.5)
        print(BEGINS, flush=True)
        end = time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            lease.put("stick", tilted)
        print(now, flush=True)
        await asyncio.sleep(LINGER)


def _striker(kind: Flood, session: zenoh.Session, vehicle: str) -> Callable[[], int]:
    """What attacks once, and returns how often it did."""
    if kind in (Flood.SETPOINTS, Flood.READ, Flood.BIG):
        return _setpoints(kind, session, vehicle)
    lease, nothing = ("do/lease", msgpack.packb({"action": "show"})), ("do/nothing", b"")
    asked = cycle(
        {
            Flood.COMMANDS: [lease],
            Flood.LOOKUPS: [("**", b"")],
            Flood.UNREAD: [("schema/**", b"")],
            Flood.LONG: [(f"{root}/**", bytes(LONG)) for root in (*roots(Use.PUBLISHED), "schema")],
        }.get(kind, [nothing])
    )
    pause = {Flood.LONG: 0.0, Flood.UNREAD: 0.01}.get(kind, 0.0001)
    kept: list[object] = []

    def strike() -> int:
        if kind is Flood.TOKENS:
            session.liveliness().declare_token(f"mk/{vehicle}/client/stranger").undeclare()  # type: ignore[no-untyped-call]
            return 1
        key, payload = next(asked)
        if kind in (Flood.LONG, Flood.UNREAD):  # no answer is read
            full: zenoh.handlers.FifoChannel[zenoh.Reply] = zenoh.handlers.FifoChannel(1)
            kept.append(session.get(f"mk/{vehicle}/{key}", full, payload=payload, timeout=60))
        else:
            session.get(
                f"mk/{vehicle}/{key}", zenoh.handlers.Callback(_read, indirect=False), payload=payload, timeout=5
            )
        time.sleep(pause)
        return 1

    return strike


def _read(reply: zenoh.Reply) -> None:
    """Read it, and that is all."""


def _setpoints(kind: Flood, session: zenoh.Session, vehicle: str) -> Callable[[], int]:
    """What puts a setpoint."""
    publisher = session.declare_publisher(
        f"mk/{vehicle}/setpoint/stick",
        congestion_control=zenoh.CongestionControl.BLOCK if kind is Flood.BIG else zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME,
    )
    sticks = {"pitch": 40.0, "roll": 40.0, "yaw": 0.0, "throttle": 0.0, "epoch": 1, "sequence": 1, "ttl": 0.3}
    payload = bytes(BIG) if kind is Flood.BIG else msgpack.packb(sticks)
    proof = bytes(32)

    def put() -> int:
        publisher.put(payload, attachment=proof)
        return 1

    return put


if __name__ == "__main__":
    main()
