"""Telling systemd that the daemon is alive: from the loop, and only while real work makes progress."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable, Mapping
from typing import Final

SLOWEST: Final = 0.5
"""Time between two looks where systemd has not asked for a faster one [s]."""


class Notifier:
    """Speaks to the service manager over the datagram socket it names; silent where there is none."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        known = os.environ if environment is None else environment
        address = known.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self.watchdog = int(known.get("WATCHDOG_USEC", "0") or "0") / 1e6

    def send(self, text: str) -> None:
        """Send one state, for example `READY=1`; a manager that has gone away is no error of ours."""
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            channel.setblocking(False)
            try:
                channel.sendto(text.encode(), self._address)
            except OSError:
                return


async def feed_watchdog(notifier: Notifier, progress: Callable[[], int], status: Callable[[], str]) -> None:
    """Report life for as long as `progress` grows, and what `systemctl status` shows.

    Args:
        notifier: the service manager.
        progress: a number that grows with the control loop; a loop that runs while control stands still is not alive.
        status: one line for people.
    """
    period = notifier.watchdog / 3 if notifier.watchdog else SLOWEST
    seen, shown = progress(), ""
    notifier.send("READY=1")
    while True:
        if (line := " ".join(status().split())) != shown:
            shown = line
            notifier.send(f"STATUS={line}")
        await asyncio.sleep(period)
        before, seen = seen, progress()
        if seen != before:
            notifier.send("WATCHDOG=1")
