"""`mkdaemon run`: the daemon, until Ctrl-C, SIGTERM, or the end of a recording."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final

import structlog
from cyclopts import Parameter

from mkdaemon.cli.mkdaemon.logs import Level, configure
from mkdaemon.cli.mkdaemon.runoptions import NONE_GIVEN, RunOptions, load_configuration
from mkdaemon.cli.program import let_signals_kill
from mkdaemon.cli.promptness import fast_loop
from mkdaemon.config.root import Config
from mkdaemon.daemon import run as run_daemon
from mkdaemon.daemon.guard import LastWord
from mkdaemon.daemon.priority import favour_loop, is_favoured, keep_threads_favoured
from mkdaemon.daemon.reloading import Reloading

RELOAD: Final = signal.SIGUSR1
"""Not SIGHUP: a daemon whose terminal is closed must end in order and not go on unseen."""


def run(
    *,
    config: Annotated[Path | None, Parameter(name=["--config", "-c"])] = None,
    options: RunOptions = NONE_GIVEN,
    log: Level = "info",
) -> None:
    """Run the daemon: show every frame on the line as a Zenoh key, answer requests, fly under a lease.

    It ends in order on Ctrl-C, on SIGTERM and at the end of a recording: control stops, the aircraft is released, the
    bus closes. A second Ctrl-C or SIGTERM ends it at once, whatever hangs, and the guard releases the aircraft. Exit
    codes: 0 as asked, 1 failed while running, 2 wrong configuration.

    SIGUSR1 makes it read its configuration again: what can be taken up is, and the log names the rest.

    Example: mkdaemon run --config vehicle.toml

    Args:
        config: TOML file; `configs/` has commented samples. Without it every default holds.
        log: Least severity written to stderr.
    """
    let_signals_kill()
    configure(log)
    cfg = load_configuration(config, options).cfg
    with asyncio.Runner(loop_factory=fast_loop()) as runner:
        runner.run(_until_signalled(cfg, lambda: load_configuration(config, options).cfg))


async def _until_signalled(cfg: Config, read: Callable[[], Config]) -> None:
    tasks = [asyncio.create_task(keep_threads_favoured(), name="priority")] if _go_first(cfg) else []
    stop, last_word, reloading = asyncio.Event(), LastWord(), Reloading(read)
    _end_on_signals(stop, last_word)
    asyncio.get_running_loop().add_signal_handler(RELOAD, reloading.ask)
    try:
        await run_daemon(cfg, stop, last_word=last_word, reloading=reloading)
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
        for name in ends:
            signal.signal(name, signal.SIG_IGN)  # a third one would cut the release short
        last_word.speak()
        signal.signal(number, signal.SIG_DFL)
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
