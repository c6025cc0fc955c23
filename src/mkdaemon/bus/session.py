"""One way to configure a Zenoh session, for the daemon and for its clients."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import socket
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal

import zenoh

from mkdaemon.bus.linger import LingerSweep
from mkdaemon.bus.tls import explain_tls_failure
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.foreignfiles import DEEPEST, read_text

ENDPOINT_SAMPLE: Final = "tcp/127.0.0.1:7447"
STALL: Final = 1.0
"""A client whose full queue of 1 MiB does not move within this time is disconnected [s]; Zenoh's own is 5."""
_ENDPOINT: Final = re.compile(r"(?P<protocol>[a-z][a-z-]*)/(?P<address>[^?#]+)")
_WITH_PORT: Final = frozenset({"tcp", "udp", "tls", "quic", "ws"})
_PORT: Final = re.compile(r"[^:]*:(?P<port>\d{1,5})|\[[0-9a-fA-F:.%a-z]+\]:(?P<port6>\d{1,5})")
_SOURCE_PLACE: Final = re.compile(r" at /[^\s,\]]+")


def session_config(
    mode: Literal["peer", "client", "router"],
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    zenoh_file: Path | None = None,
    lease: float = 2.0,
    patience: float = 2.0,
    more: Mapping[str, object] = MappingProxyType({}),
) -> zenoh.Config:
    """Make a session's configuration: no scouting, no waiting, quick reconnection.

    Args:
        mode: `client` for programs that only meet the daemon; two leaf peers would not see each other through it.
        listen: endpoints to listen on.
        connect: endpoints to connect to.
        zenoh_file: JSON5 file that comes first: TLS, access control.
        lease: silence after which the other side counts as gone [s].
        patience: longest time a client tries to connect [s].
        more: further settings; a list is added to that of the file.

    Raises:
        ConfigError: the file or an endpoint is wrong.
    """
    if zenoh_file is not None:
        _check_file(zenoh_file)
    try:
        config = zenoh.Config() if zenoh_file is None else zenoh.Config.from_file(zenoh_file)
    except zenoh.ZError as error:
        msg = f"{zenoh_file}: no usable Zenoh configuration: {_plain_words(error)}"
        raise ConfigError(msg) from error
    settings = _measured_settings(mode, lease, patience)
    # An own file keeps its own endpoints unless ours are given; without one, Zenoh would listen on all interfaces.
    for place, endpoints in (("connect/endpoints", connect), ("listen/endpoints", listen)):
        if endpoints or config.get_json(place) == zenoh.Config().get_json(place):
            settings[place] = list(endpoints)
    for endpoint in listen:
        check_endpoint(endpoint, "bus.listen")
    for endpoint in connect:
        check_endpoint(endpoint, "--connect" if mode == "client" else "bus.connect")
    for key, value in more.items():
        settings[key] = [*json.loads(config.get_json(key)), *value] if isinstance(value, list) else value
    for key, value in settings.items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            msg = f"Zenoh refuses {key} = {value}: {_plain_words(error)}"
            raise ConfigError(msg) from error
    return config


def _measured_settings(mode: str, lease: float, patience: float) -> dict[str, object]:
    """What measurements showed necessary; an unset scouting delay alone costs 500 ms at every start."""
    settings: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": int(lease * 1000),
        # 1 MiB for telemetry in place of 128 KiB: a subscriber may stand still for a second before samples are dropped.
        "transport/link/tx/queue/size/data": 16,
        # Zenoh does not check the length of a message in shared memory, its writer can change it while it is read, and
        # 16 MiB stay mapped for each client that ever sent a long one: two such clients cost the daemon 75 MiB.
        "transport/shared_memory/enabled": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "connect/timeout_ms": int(patience * 1000) if mode == "client" else -1,
    }
    if mode == "peer":
        settings["connect/exit_on_failure"] = False
        # What must not be lost (the end of a query) waits this long for a stuck client; then it is cut off.
        settings["transport/link/tx/queue/congestion_control/block/wait_before_close"] = int(STALL * 1_000_000)
    return settings


def _check_file(path: Path) -> None:
    """Make sure that Zenoh's reader survives a file: brackets nested deep are its end, and a pipe it waits for.

    Raises:
        ConfigError: it cannot be read, or nests too deep.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else error.strerror
        msg = f"{path}: no usable Zenoh configuration: {reason}"
        raise ConfigError(msg) from error
    depth = 0
    for bracket in re.findall(r"[\[\]{}]", text):
        depth += 1 if bracket in "[{" else -1
        if depth > DEEPEST:
            msg = f"{path}: no usable Zenoh configuration: it nests deeper than {DEEPEST}"
            raise ConfigError(msg)


def check_endpoint(endpoint: str, place: str) -> None:
    """Check the form of an endpoint: Zenoh's own message about a wrong one does not name the mistake.

    Args:
        endpoint: `<protocol>/<address>`, where protocols of the Internet need a port.
        place: what to call it: a configuration key or an option.

    Raises:
        ConfigError: it is none.
    """
    form = _ENDPOINT.match(endpoint)
    if form is not None and form["protocol"] in _WITH_PORT:
        port = _PORT.fullmatch(form["address"])
        if port is None or int(port["port"] or port["port6"]) > 65535:
            form = None
    if form is None:
        msg = f"{place}: {endpoint!r} is not a Zenoh endpoint; write it like {ENDPOINT_SAMPLE}"
        raise ConfigError(msg)


async def open_session(config: zenoh.Config, *, listen: Sequence[str] = ()) -> zenoh.Session:
    """Open a session without holding up the loop.

    Raises:
        MkError: an endpoint is in use, or no program answers at it.
        ConfigError: an endpoint cannot be understood.
    """
    try:
        return await asyncio.to_thread(zenoh.open, config)
    except zenoh.ZError as error:
        text = _plain_words(error)
        if "in use" in text:
            msg = (
                f"bus.listen {', '.join(listen)} is in use: another mkdaemon runs here. "
                "End it, or give this one another endpoint with --listen tcp/127.0.0.1:PORT"
            )
            raise MkError(msg) from error
        if "Unable to connect" in text:
            if (refusal := await asyncio.to_thread(explain_tls_failure, config)) is not None:
                raise MkError(refusal) from error
            endpoints = json.loads(config.get_json("connect/endpoints"))
            where = ", ".join(endpoints)
            if unknown := await asyncio.to_thread(_unknown_hosts, endpoints):
                msg = f"no machine is known by the name {', '.join(unknown)}: correct it, or give its address"
                raise MkError(msg) from error
            if await asyncio.to_thread(_is_taken, endpoints):
                msg = (
                    f"a program listens at {where} but does not answer: that machine or this one is busy, so ask again;"
                    " or one side asks for a certificate, the other has none (docs/security.md); or it is no mkdaemon"
                )
                raise MkError(msg) from error
            msg = f"no program answers at {where}: is mkdaemon running there? (`mkdaemon run`, or --connect elsewhere)"
            raise MkError(msg) from error
        msg = f"Zenoh session: {text}"
        raise ConfigError(msg) from error


def _places(endpoints: Sequence[str]) -> Iterator[tuple[str, int]]:
    """Hosts and ports of those that are reached over TCP."""
    for endpoint in endpoints:
        protocol, _, address = endpoint.partition("/")
        host, _, port = re.split("[?#]", address)[0].rpartition(":")
        if protocol in {"tcp", "tls"} and port.isdigit():
            yield host.strip("[]"), int(port)


def _unknown_hosts(endpoints: Sequence[str]) -> list[str]:
    """Hosts that have no address."""
    unknown = []
    for host, port in _places(endpoints):
        try:
            socket.getaddrinfo(host, port)
        except OSError:
            unknown.append(host)
    return unknown


def _is_taken(endpoints: Sequence[str]) -> bool:
    """Whether a program listens at one of these: its kernel takes a connection even where it has no time itself."""
    for place in _places(endpoints):
        with contextlib.suppress(OSError), socket.create_connection(place, 1.0):
            return True
    return False


async def close_session(session: zenoh.Session) -> None:
    """Close a session; must be done explicitly, or the interpreter hangs at exit when callbacks are declared."""
    LingerSweep().sweep()
    # A peer that takes nothing can make it time out; everything of ours is closed all the same.
    with contextlib.suppress(zenoh.ZError):
        await asyncio.to_thread(session.close)


def _plain_words(error: zenoh.ZError) -> str:
    return _SOURCE_PLACE.sub("", str(error)).rstrip(".")
