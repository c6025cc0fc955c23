"""Two programs beside a gateway: one notes when a value is on the bus, one is the least that a gateway can be.

`witness` notes when each attitude came to a client of the bus, and when the relay's copy of it came at a socket.
`relay` sends each attitude on as it is, by UDP, from Zenoh's own thread: what it takes, this machine takes for any
process between the bus and a socket. Its figure is the floor of the gateways' figures, from the same values.
"""

from __future__ import annotations

import gc
import socket
import sys
import time
from typing import Any

import msgpack
import zenoh

from lab.rigs.stamped import be_instrument, go_first, receive, stamp_arrivals
from mkdaemon.bus.session import session_config

KEY = "state/attitude"


def main(role: str, endpoint: str, vehicle: str, port: int) -> None:
    """Be one of the two until standard input ends.

    Args:
        role: witness or relay.
        port: of this machine, where the relay sends to and the witness listens.
    """
    gc.disable()
    {"witness": _witness, "relay": _relay}[role](endpoint, f"mk/{vehicle}/{KEY}", port)


def _session(endpoint: str) -> zenoh.Session:
    return zenoh.open(session_config("client", connect=[endpoint]))


def _witness(endpoint: str, key: str, port: int) -> None:
    is_first = go_first()
    seen: list[tuple[bytes, int]] = []
    relayed: list[tuple[bytes, int]] = []
    where = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    where.bind(("127.0.0.1", port))
    stamp_arrivals(where)

    def listen() -> None:
        while True:
            relayed.append(receive(where))

    def on_sample(sample: zenoh.Sample) -> None:
        at = time.time_ns()
        seen.append((bytes(sample.payload), at))

    def result() -> dict[str, Any]:
        return {"is_first": is_first, "bus": _stamped(seen), "relay": _stamped(relayed)}

    with _session(endpoint) as session:
        session.declare_subscriber(key, zenoh.handlers.Callback(on_sample, indirect=False))
        be_instrument(listen, result)


def _stamped(came: list[tuple[bytes, int]]) -> list[tuple[float, float, int]]:
    """Monotonic and wall time of each value [s], and when it came [ns]."""
    stamps = ((msgpack.unpackb(raw)["stamp"], at) for raw, at in came)
    return [(stamp["monotonic"], stamp["wall"], at) for stamp, at in stamps]


def _relay(endpoint: str, key: str, port: int) -> None:
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.connect(("127.0.0.1", port))

    def on_sample(sample: zenoh.Sample) -> None:
        out.send(bytes(sample.payload))

    def rest() -> None:
        while True:
            time.sleep(3600.0)

    with _session(endpoint) as session:
        session.declare_subscriber(key, zenoh.handlers.Callback(on_sample, indirect=False))
        be_instrument(rest, dict[str, Any])


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))
