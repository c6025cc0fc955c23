"""`mkdaemon gateway mavlink` as a program: keys, folders, signals, and reconnection to a daemon that restarts."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from pathlib import Path
from typing import Final

import structlog

from mkdaemon.client import Vehicle
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.foreignfiles import read_text
from mkdaemon.gateways.boardset import backups_folder
from mkdaemon.gateways.mavlink.addresses import DEFAULTS, check_addresses, read_address
from mkdaemon.gateways.mavlink.gateway import MavlinkGateway, Options
from mkdaemon.gateways.mavlink.signing import Signing, key_from

_LONGEST_KEY: Final = 1000
_AGAIN: Final = 2.0
"""Between two attempts to reach the daemon [s]."""
_log: Final = structlog.get_logger("gateway.mavlink")


def options_from(
    links: tuple[str, ...],
    system: int,
    signing_key: Path | None,
    backups: Path | None,
    *,
    allow_open: bool,
    target: str = "",
) -> Options:
    """The options of the gateway from what a user gave.

    Args:
        links: addresses; none for the usual ones.
        system: number of the aircraft.
        signing_key: file of the key; None for none.
        backups: folder of settings; None for the usual one.
        allow_open: let any program in the network fly.
        target: that is flown by; empty for the one in sight.

    Raises:
        ConfigError: an address or the key cannot be used; says what to do.
    """
    addresses = tuple(read_address(text) for text in links or DEFAULTS)
    if not 1 <= system <= 250:
        raise ConfigError(f"--system {system}: an aircraft has a number of 1 to 250")
    folder = backups or backups_folder("mavlink")
    signing = None
    if signing_key is not None:
        signing = Signing(_read_key(signing_key), folder / "signing-times.json")
    check_addresses(addresses, has_key=signing is not None, allow_open=allow_open)
    return Options(addresses, system, signing, folder, target)


def _read_key(path: Path) -> bytes:
    try:
        text = read_text(path, limit=_LONGEST_KEY)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"--signing-key {path}: cannot be read ({error}); `openssl rand -hex 32 > {path}`") from error
    if not text.strip():
        raise ConfigError(f"--signing-key {path}: is empty; `openssl rand -hex 32 > {path}`")
    return key_from(text)


async def serve(
    open_vehicle: Callable[[], AbstractAsyncContextManager[Vehicle]], options: Options, on_ready: Callable[[], None]
) -> None:
    """Serve ground stations until it is cancelled; connect to the daemon again and again until it is there.

    Args:
        open_vehicle: connects to the daemon.
        options: see there.
        on_ready: called when all links are open.

    Raises:
        MkError: a link cannot be opened, or the vehicle is not named rightly.
    """
    is_logged = False
    while True:
        async with AsyncExitStack() as stack:
            try:
                uav = await stack.enter_async_context(open_vehicle())
            except ConfigError:
                raise
            except MkError as error:
                if not is_logged:
                    _log.warning("the daemon is not there yet: waiting for it", error=str(error))
                    is_logged = True
                await asyncio.sleep(_AGAIN)
                continue
            await MavlinkGateway(uav, options, time.monotonic, time.time).run(on_ready)
            return
