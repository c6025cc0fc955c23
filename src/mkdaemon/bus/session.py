"""One way to configure a Zenoh session, for the daemon and for its clients."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import zenoh

from mkdaemon.errors import ConfigError, MkError

_SOURCE_PLACE = re.compile(r" at /[^\s,\]]+")


def session_config(
    mode: Literal["peer", "client", "router"],
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    zenoh_file: Path | None = None,
    lease: float = 2.0,
    patience: float = 2.0,
) -> zenoh.Config:
    """Make a session's configuration: no scouting, no waiting, quick reconnection.

    Args:
        mode: `client` for programs that only meet the daemon; two leaf peers would not see each other through it.
        listen: endpoints to listen on.
        connect: endpoints to connect to.
        zenoh_file: JSON5 file that comes first: TLS, access control.
        lease: silence after which the other side counts as gone [s].
        patience: longest time a client tries to connect [s].

    Raises:
        ConfigError: the file or an endpoint is wrong.
    """
    try:
        config = zenoh.Config() if zenoh_file is None else zenoh.Config.from_file(zenoh_file)
    except zenoh.ZError as error:
        msg = f"{zenoh_file}: no usable Zenoh configuration: {_plain_words(error)}"
        raise ConfigError(msg) from error
    # An own file keeps its own endpoints unless ours are given; everything else is what platform measurements showed
    # necessary: an unset scouting delay alone costs 500 ms at every start.
    keep = zenoh_file is not None
    settings: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": int(lease * 1000),
        # 1 MiB for telemetry in place of 128 KiB: a subscriber may stand still for a second before samples are dropped.
        "transport/link/tx/queue/size/data": 16,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "connect/timeout_ms": int(patience * 1000) if mode == "client" else -1,
    }
    if mode == "peer":
        settings["connect/exit_on_failure"] = False
    if connect or not keep:
        settings["connect/endpoints"] = list(connect)
    if listen or not keep:
        settings["listen/endpoints"] = list(listen)
    for key, value in settings.items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            msg = f"bus.{key.replace('/endpoints', '')}: {value} is not valid: {_plain_words(error)}"
            raise ConfigError(msg) from error
    return config


async def open_session(config: zenoh.Config, *, listen: Sequence[str] = ()) -> zenoh.Session:
    """Open a session without holding up the loop.

    Raises:
        MkError: an endpoint is in use, or nobody answers at it.
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
            msg = f"nobody answers at {config.get_json('connect/endpoints')}: is mkdaemon running there?"
            raise MkError(msg) from error
        msg = f"Zenoh session: {text}"
        raise ConfigError(msg) from error


async def close_session(session: zenoh.Session) -> None:
    """Close a session; must be done explicitly, or the interpreter hangs at exit when callbacks are declared."""
    # A peer that takes nothing can make it time out; everything of ours is closed all the same.
    with contextlib.suppress(zenoh.ZError):
        await asyncio.to_thread(session.close)


def _plain_words(error: zenoh.ZError) -> str:
    return _SOURCE_PLACE.sub("", str(error)).rstrip(".")
