"""What every gateway says once it serves."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from mkdaemon.cli.printing import show


def announce_serving(gateway: str, vehicles: Sequence[str], where: str, *, as_json: bool) -> None:
    """Print the one line that a gateway writes to standard output, when others can connect.

    Args:
        gateway: its name.
        vehicles: that it serves.
        where: an address, several, or a namespace, in the words of the other system.
        as_json: as an object with `gateway`, `vehicles` and `where`.
    """
    words = f"{gateway} gateway: {', '.join(vehicles)} at {where}; Ctrl-C ends it"
    show({"gateway": gateway, "vehicles": list(vehicles), "where": where}, words, as_json=as_json)
    sys.stdout.flush()
