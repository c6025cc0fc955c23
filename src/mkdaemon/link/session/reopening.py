"""Coming back: delays between attempts, a device that returns under another name, a line rate that is wrong."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mkdaemon.errors import ConfigError, LinkLostError
from mkdaemon.link.ports.port import parse_address
from mkdaemon.link.session.verdict import HeldFinding, VerdictCause, VerdictFinding
from mkdaemon.telemetry.link import LinkCondition

BAUDS: Final = (57600, 115200, 38400, 19200, 9600, 230400)
"""Line rates to try; 57600 is MikroKopter's, the others are adapters and radios set wrongly."""
GARBAGE_PATIENCE: Final = 1.0
"""Garbage for this long means a wrong line rate rather than noise [s]."""
PROVEN_PATIENCE: Final = 10.0
"""The same on a line that was understood at this rate before [s]: noise is likelier than another rate."""
MUTE_PATIENCE: Final = 6.0
"""A line that never said anything may be a line at the wrong rate whose board understands nothing [s]; longer than a
FlightCtrl boots, which says nothing either where its text is lost."""
SILENT_PATIENCE: Final = 0.8
"""While searching: no frame for this long, and the next rate is tried [s]."""
STUCK_PATIENCE: Final = 2.0
"""A port that takes no bytes for this time is reopened [s]."""


def backoff(first: float, longest: float, *, factor: float = 1.6) -> Iterator[float]:
    """Yield growing delays for ever.

    Args:
        first: the first delay [s].
        longest: never more than this [s].
        factor: growth.
    """
    delay = first
    while True:
        yield min(delay, longest)
        delay = min(delay * factor, longest)


class BaudSearch:
    """Decides which line rate to open the port with.

    Attributes:
        current: rate to open with [baud].
        attempt: what is tried, under the condition the search began with (garbage, or mute from the very start); None
            while not searching.
    """

    def __init__(self, configured: int, *, enabled: bool) -> None:
        self.current = configured
        self.attempt: VerdictFinding | None = None
        self._configured = configured
        self._enabled = enabled
        self._others = itertools.cycle(baud for baud in BAUDS if baud != configured)
        self._understood: int | None = None

    def reason_to_reopen(self, verdict: HeldFinding, opened: float, now: float) -> str | None:
        """Say why the port must be closed and opened again (perhaps at another rate); None where it need not."""
        if verdict.condition.hears_board:
            self.attempt, self._understood = None, self.current
            return None
        if verdict.cause is VerdictCause.PORT_STUCK and now - verdict.since > STUCK_PATIENCE:
            return verdict.reason
        if not self._enabled or now - self._search_time(verdict, opened) <= 0:
            return None
        condition = verdict.condition if self.attempt is None else self.attempt.condition
        tried, self.current = self.current, self._next_baud()
        doubt = " (or no board is switched on)" if condition is LinkCondition.MUTE else ""
        self.attempt = VerdictFinding(condition, f"no frame at {tried} baud{doubt}: trying {self.current}")
        return self.attempt.reason

    def end_search(self) -> None:
        """Open the next port at the rate that was understood last: it is another device, or ours came back."""
        self.current, self.attempt = self._understood or self.current, None

    def _search_time(self, verdict: HeldFinding, opened: float) -> float:
        """When to try the next rate [s]; infinite while the line rate is not in doubt."""
        if verdict.cause is VerdictCause.PLAIN_TEXT:
            return math.inf
        if self.attempt is not None:
            return opened + SILENT_PATIENCE
        if verdict.condition is LinkCondition.GARBAGE:
            return verdict.since + (PROVEN_PATIENCE if self._understood else GARBAGE_PATIENCE)
        if verdict.condition is LinkCondition.MUTE and not self._understood:
            return verdict.since + MUTE_PATIENCE
        return math.inf

    def _next_baud(self) -> int:
        """The configured rate every second time: it is the likely one once the fault has gone."""
        return self._configured if self.current != self._configured else next(self._others)


class AliasMemory:
    """Remembers the by-id name of a device, because ttyUSB numbers change when a cable is plugged in again."""

    def __init__(self, folder: Path = Path("/dev/serial/by-id")) -> None:
        self._folder = folder
        self._alias: str | None = None

    def learn(self, url: str) -> None:
        """A port was opened under this address: remember its lasting name, the first time."""
        address = parse_address(url)
        if self._alias is not None or address.scheme != "serial" or not self._folder.is_dir():
            return
        name = self._name_of(Path(address.target))
        if name is not None:
            self._alias = str(self._folder / name)

    def find(self, url: str) -> str | None:
        """Return the lasting name of a device that is not where it was; None where there is none.

        Raises:
            LinkLostError: another device has taken its address, and it is nowhere: that one must not be written to.
        """
        if self._alias is None:
            return None
        try:
            device = Path(parse_address(url).target)
        except ConfigError:
            return None
        if Path(self._alias).exists():
            return self._alias if device.resolve() != Path(self._alias).resolve() else None
        other = self._name_of(device) if device.exists() else None
        if other is not None:
            msg = (
                f"{device} is now another adapter ({other}) and was not opened: plug {Path(self._alias).name} in, "
                "or name the other one in link.port and start the daemon again"
            )
            raise LinkLostError(msg)
        return None

    def _name_of(self, device: Path) -> str | None:
        """The lasting name of what is at an address; None where it has none."""
        here = device.resolve()
        entries = sorted(self._folder.iterdir()) if self._folder.is_dir() else []
        return next((entry.name for entry in entries if entry.resolve() == here), None)
