"""The one way in for what Zenoh delivers: whatever arrives, nothing is raised on its threads.

Every program on the bus may put to a wildcard (`mk/**`), delete, or send any bytes: a callback drops and counts what it
does not understand. An exception would be printed with its traceback, once for each sample of a flood.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh

_log = logging.getLogger(__name__)
_Item = TypeVar("_Item")


def direct(
    take: Callable[[_Item], None],
    drop: Callable[[], None] = lambda: None,
    *,
    end: Callable[[], Any] | None = None,
) -> zenoh.handlers.Callback[_Item]:
    """Make a callback that runs on the thread that received, and never raises.

    Args:
        take: takes what arrived; whatever it raises is logged at DEBUG.
        drop: called for each item on which `take` raised; counts it.
        end: called when nothing more can come.
    """

    def take_or_drop(item: _Item) -> None:
        try:
            take(item)
        except Exception:  # noqa: BLE001
            # Untrusted: a malicious payload must neither end a thread nor fill a log.
            _log.debug("dropped what arrived", exc_info=True)
            drop()

    return zenoh.handlers.Callback(take_or_drop, end, indirect=False)
