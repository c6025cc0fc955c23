"""How late this machine wakes a program that only sleeps: what no player can be better than.

A process of its own, `python -m lab.record.sleeper`; it ends by an interrupt and prints the figures as JSON.
"""

from __future__ import annotations

import gc
import json
import time
from typing import Final

PERIOD: Final = 0.0023
"""Between two moments at which it wants to be woken [s]: about as often as a player."""


def main() -> None:
    """Sleep until an interrupt."""
    gc.disable()
    late: list[float] = []
    try:
        while True:
            due = time.monotonic() + PERIOD
            time.sleep(PERIOD)
            late.append(time.monotonic() - due)
    except KeyboardInterrupt:
        late.sort()
        shares = {"p50_ms": 0.5, "p99_ms": 0.99, "p999_ms": 0.999}
        print(json.dumps({name: 1e3 * late[int(share * len(late))] for name, share in shares.items()}))


if __name__ == "__main__":
    main()
