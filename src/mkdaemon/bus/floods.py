"""Limits that keep a flood of one client from costing another its lease.

What is too long is dropped inside Zenoh, before Python sees it, and so are setpoints of strangers (`setpointroot`) and
what they put to keys of the daemon. The rest is bounded here, on Zenoh's threads, and counted. Zenoh's own limit of a
rate (`downsampling`) serves keys that no client may put; for setpoints of the holder it is not used: of those that a
slow network delivers together it would take the first and drop the newest.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from mkdaemon.bus.keyspec import REQUEST_BYTES
from mkdaemon.bus.names import key
from mkdaemon.bus.setpointroot import PLAIN_ROOT

STRANGER_RATE: Final = 100.0
"""Setpoints of one kind below the secret root that the holder did not sign, from all connections together [Hz]."""
PLAIN_RATE: Final = 50.0
"""Setpoints at the plain keys, which no client may use, that are passed on from each connection [Hz]: enough for a
look of 0.05 s to find one and refuse it. While any client subscribes to `mk/**`, the whole flood leaves its sender;
routed on to `mkctl log record` it cost the lease in 6 of 6 flights on two cores."""
POSITION_RATE: Final = 300.0
"""Reports at the plain key of a source of poses without a secret that are passed on from each connection [Hz]: the
fastest systems measure as often."""
UNSTAMPED_RATE: Final = 200.0
"""Setpoints of the holder that do not say when they were sent [Hz]: while more come than that, none is taken."""
LONGEST_SETPOINT: Final = 1 << 16
"""A longer one is dropped without a word [bytes]; one of more than 512 is refused with a reason."""
LONGEST_MESSAGE: Final = 1 << 20
"""Longest message put together from its fragments [bytes], where no camera brings its images over the bus; the longest
request has 128 kB. A longer one is dropped."""
LONGEST_IMAGE: Final = 1 << 27
"""The same where one does; an image may have 64 million pixels."""
PENDING: Final = 300
"""Connections that may be silent at a time before new ones are turned away."""
SESSIONS: Final = 300
"""Clients at a time. Together with the silent ones this stays well below 1,024 open files: a service may not open more,
and pyserial cannot watch a port with a higher number (select(2), FD_SETSIZE)."""
PENDING_TIME: Final = 5.0
"""A connection that has not introduced itself within this time is closed [s]."""
ALL_OTHERS: Final = "others"
URGENT: Final[Mapping[str, float]] = {"do/release": 20.0, "do/abort": 20.0}
"""Commands that end a flight or a manoeuvre, which anyone may: what else is asked makes them wait for nothing."""
QUERY_RATES: Final[Mapping[str, float]] = {**URGENT, "do/lease": 50.0, ALL_OTHERS: 200.0}
"""Commands taken a second [Hz], and at once: each kind has its own, so that no flood shuts out a release."""
REPORT_PERIOD: Final = 1.0
"""Time between two reports of what was shed [s]."""


def flood_settings(
    vehicle: str,
    kinds: tuple[str, ...],
    published: tuple[str, ...],
    positions: Mapping[str, float] = MappingProxyType({}),
    *,
    takes_images: bool = False,
) -> dict[str, object]:
    """Zenoh's own limits for the daemon's session; see DEFAULT_CONFIG.json5 of Zenoh 1.10.

    Args:
        vehicle: its name.
        kinds: suffixes to which setpoints are put.
        published: first chunks of the keys to which the daemon alone puts.
        positions: largest rates at the plain keys of sources of poses [Hz].
        takes_images: whether a camera brings its images over the bus.
    """
    keys = [key(vehicle, kind) for kind in kinds]
    limits = {f"{PLAIN_ROOT}/*": PLAIN_RATE, **{f"{root}/**": 0.0 for root in published}, **positions}
    return {
        "low_pass_filter": [
            {
                "id": "mkdaemon-setpoints",
                "messages": ["put"],
                "flows": ["ingress"],
                "key_exprs": keys,
                "size_limit": LONGEST_SETPOINT,
            }
        ],
        # Each in its own item: what is put to a wildcard has to pass them all, and of one item's rules only one.
        "downsampling": [
            {
                "id": f"mkdaemon-{suffix}",
                "messages": ["put", "delete"],
                "flows": ["ingress"],
                "rules": [{"key_expr": key(vehicle, suffix), "freq": rate}],
            }
            for suffix, rate in limits.items()
        ],
        "transport/link/rx/max_message_size": LONGEST_IMAGE if takes_images else LONGEST_MESSAGE,
        "transport/unicast/accept_pending": PENDING,
        "transport/unicast/max_sessions": SESSIONS,
        "transport/unicast/accept_timeout": int(PENDING_TIME * 1000),
    }


class ShedCounter:
    """Counts what was shed, by what it was; from any thread."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._lock = threading.Lock()

    def add(self, what: str) -> None:
        """Count one."""
        with self._lock:
            self._counts[what] += 1

    def take(self) -> dict[str, int]:
        """Return the counts since the last call, the largest first."""
        with self._lock:
            counts, self._counts = self._counts, Counter()
        return dict(counts.most_common())


class Budget:
    """Allows a number a second, and as many at once; from any thread."""

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin with a full second's worth.

        Args:
            rate: [Hz].
            clock: [s].
        """
        self._rate, self._clock = rate, clock
        self._left, self._at = rate, clock()
        self._lock = threading.Lock()

    def admits(self, cost: float = 1.0) -> bool:
        """Whether one more is taken now.

        Args:
            cost: how many it counts for, half a second's worth at most.
        """
        cost = min(cost, self._rate / 2)
        with self._lock:
            now = self._clock()
            self._left = min(self._rate, self._left + (now - self._at) * self._rate)
            self._at = now
            if self._left < cost:
                return False
            self._left -= cost
            return True


class Silencer(Budget):
    """Admits nothing while more comes than a rate, and for half a second after that; from any thread."""

    def admits(self, cost: float = 1.0) -> bool:
        """Whether one more is taken now; one that is not taken counts as well.

        Args:
            cost: how many it counts for.
        """
        with self._lock:
            now = self._clock()
            left = min(self._rate, self._left + (now - self._at) * self._rate)
            self._left, self._at = max(left - cost, -self._rate / 2), now
            return self._left >= 0.0


class QueryBudgets:
    """Budgets of commands by kind."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._budgets = {kind: Budget(rate, clock) for kind, rate in QUERY_RATES.items()}

    def admit(self, suffix: str, size: int = 0) -> bool:
        """Whether one more command is taken now.

        Args:
            suffix: its key without `mk/<vehicle>/`.
            size: of its payload [bytes]; a long one counts for as many as an ordinary request is long.
        """
        return self._budgets.get(suffix, self._budgets[ALL_OTHERS]).admits(max(1.0, size / REQUEST_BYTES))
