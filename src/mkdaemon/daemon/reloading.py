"""Reading the configuration again while the daemon runs: what can be taken up is, what cannot is named."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from mkdaemon.config.reload import plan_reload
from mkdaemon.config.root import Config
from mkdaemon.daemon.audit import Audit
from mkdaemon.errors import ConfigError


class Reloading:
    """Reads the configuration again on request."""

    def __init__(self, read: Callable[[], Config]) -> None:
        """Wait to be asked.

        Args:
            read: reads the configuration as at the start; called on a separate thread.
        """
        self._read = read
        self._asked = asyncio.Event()

    def ask(self) -> None:
        """Ask for it; from the loop."""
        self._asked.set()

    async def follow(self, running: Config, take: Callable[[Config], None], audit: Audit) -> None:
        """Read the file each time it is asked for, for ever.

        Args:
            running: the configuration at the start.
            take: takes up what can be taken up.
            audit: hears what was taken, and what needs a restart.
        """
        while True:
            await self._asked.wait()
            self._asked.clear()
            try:
                wanted = await asyncio.to_thread(self._read)
            except ConfigError as error:
                audit.log("error", f"configuration not reloaded, the running one stays: {error}")
                continue
            plan = plan_reload(running, wanted)
            running = plan.cfg
            take(running)
            taken = ", ".join(plan.taken) or "no key that can change at run time differs"
            audit.log("info", f"configuration reloaded: {taken}")
            if plan.waiting:
                audit.log("warning", f"needs a restart, on the ground: {', '.join(plan.waiting)}")
