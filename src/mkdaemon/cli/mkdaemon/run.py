"""`mkdaemon run`: the daemon, until Ctrl-C, SIGTERM, or the end of a recording."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path
from typing import Annotated, Any

import structlog
from cyclopts import Parameter

from mkdaemon.cli.mkdaemon.logs import Level, configure
from mkdaemon.cli.program import let_signals_kill
from mkdaemon.cli.promptness import fast_loop
from mkdaemon.config.reader import load
from mkdaemon.config.root import Config
from mkdaemon.daemon import run as run_daemon
from mkdaemon.daemon.guard import LastWord
from mkdaemon.daemon.priority import favour_loop, is_favoured, keep_threads_favoured


def run(
    *,
    config: Annotated[Path | None, Parameter(name=["--config", "-c"])] = None,
    port: Annotated[str | None, Parameter(name=["--port", "-p"])] = None,
    vehicle: str | None = None,
    listen: str | None = None,
    wait: Annotated[bool, Parameter(negative=())] = False,
    real_time: Annotated[bool, Parameter(negative=())] = False,
    no_record: Annotated[bool, Parameter(negative=())] = False,
    log: Level = "info",
) -> None:
    """Run the daemon: show every frame on the line as a Zenoh key, answer requests, fly under a lease.

    It ends in order on Ctrl-C, on SIGTERM and at the end of a recording: control stops, the aircraft is released, the
    bus closes. A second Ctrl-C or SIGTERM ends it at once, whatever hangs, and the guard releases the aircraft. Exit
    codes: 0 as asked, 1 failed while running, 2 wrong configuration.

    Args:
        config: TOML file; `configs/` has commented samples. Without it every default holds.
        port: `/dev/ttyUSB0`, `/dev/serial/by-id/...`, `pty:/dev/pts/N`, `tcp:HOST:PORT` or `replay:FILE?speed=20`; goes
            before the file's `link.port`.
        vehicle: Name in every key, `mk/<vehicle>/...`; goes before the file's `vehicle.name`. Without both a file and
            this option the environment's `MK_VEHICLE` counts, which names the vehicle that clients talk to.
        listen: Zenoh endpoint for clients, for example `tcp/127.0.0.1:7448`; goes before the file's `bus.listen`.
        wait: Wait for the port if it is missing at the start, in place of ending; a recording waits for a subscriber.
        real_time: Go before other programs, as a service does by itself; docs/operations.md says what that can starve.
        no_record: Make no recording of this run; goes before the file's `record.enabled`.
        log: Least severity written to stderr.
    """
    let_signals_kill()
    configure(log)
    overrides: dict[str, Any] = {}
    if port is not None:
        overrides["link.port"] = port
    name = vehicle_name(config, vehicle)
    if name:
        overrides["vehicle.name"] = name
    if listen is not None:
        overrides["bus.listen"] = [listen]
    if wait:
        overrides["link.wait_for_port"] = True
    if real_time:
        overrides["control.real_time"] = True
    if no_record:
        overrides["record.enabled"] = False
    cfg = load(config, overrides)
    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        runner.run(_until_signalled(cfg))


def vehicle_name(config: Path | None, given: str | None) -> str | None:
    """Return the name that goes before the file's; the environment's is the clients' and names no file's aircraft."""
    return given or (os.environ.get("MK_VEHICLE") if config is None else None)


async def _until_signalled(cfg: Config) -> None:
    tasks = [asyncio.create_task(keep_threads_favoured(), name="priority")] if _go_first(cfg) else []
    stop, last_word = asyncio.Event(), LastWord()
    _end_on_signals(stop, last_word)
    try:
        await run_daemon(cfg, stop, last_word=last_word)
    finally:
        let_signals_kill()
        for task in tasks:
            task.cancel()


def _end_on_signals(stop: asyncio.Event, last_word: LastWord) -> None:
    """Let the first signal end the daemon in order, and the second one at once, whatever hangs.

    With a guard the second one kills: the guard sees that and releases the aircraft. Without one the last word does,
    from within the handler: the loop may hang, too.
    """
    loop = asyncio.get_running_loop()
    ends = (signal.SIGINT, signal.SIGTERM)

    def end_at_once(number: int, _: object) -> None:
        let_signals_kill()
        last_word.speak()
        signal.raise_signal(number)

    def end_in_order(_: int, __: object) -> None:
        loop.call_soon_threadsafe(stop.set)
        if last_word.is_guarded:
            let_signals_kill()
            return
        for name in ends:
            signal.signal(name, end_at_once)

    for name in ends:
        signal.signal(name, end_in_order)


def _go_first(cfg: Config) -> bool:
    """Put the loop before other programs where that is wanted; returns whether it is."""
    if not is_favoured(cfg.control.real_time, os.environ):
        return False
    if not favour_loop():
        structlog.get_logger().warning("ordinary priority: the system refuses a real-time one; grant LimitRTPRIO=2")
    return True
