"""What tests of the bus share: a loopback endpoint of their own and a plain client."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from types import MappingProxyType

import msgpack
import zenoh

from lab.rigs.waiting import PATIENCE
from mkdaemon.bus.endpoint import reserved_endpoint
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.session import session_config
from mkdaemon.config.bus import BusConfig

_RESERVED = ExitStack()


def free_endpoint() -> str:
    """A TCP endpoint on loopback that nobody else is given until `give_back_endpoints`."""
    return _RESERVED.enter_context(reserved_endpoint())


def give_back_endpoints() -> None:
    """Let others have the endpoints reserved so far."""
    _RESERVED.close()


def bus_config(endpoint: str, **more: object) -> BusConfig:
    """A bus whose clients may stand still for as long as the configuration allows."""
    return BusConfig.model_validate({"listen": (endpoint,), "lease": 30.0, **more})


@contextmanager
def client(endpoint: str, more: Mapping[str, object] = MappingProxyType({})) -> Iterator[zenoh.Session]:
    """A client session as any program would open it; `more` are further settings of Zenoh's."""
    session = zenoh.open(session_config("client", connect=[endpoint], patience=PATIENCE, lease=PATIENCE, more=more))
    try:
        yield session
    finally:
        session.close()


def sticks_of(bus: Bus) -> str:
    """The key at which a bus takes sticks from the holder of the lease."""
    return f"mk/{bus.vehicle}/{bus.setpoint_root}/stick"


def ask(session: zenoh.Session, key: str, payload: dict | bytes | None = None, timeout: float = PATIENCE) -> list:
    """Every reply to a query as (key, map or bytes, encoding)."""
    body = msgpack.packb(payload) if isinstance(payload, dict) else payload
    replies = []
    for reply in session.get(key, payload=body, timeout=timeout):
        raw = reply.ok.payload.to_bytes()
        encoding = str(reply.ok.encoding)
        value = msgpack.unpackb(raw) if "msgpack" in encoding else raw
        replies.append((str(reply.ok.key_expr), value, encoding))
    return replies
