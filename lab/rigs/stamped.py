"""When something came, by who is not kept waiting: the kernel's own time stamps, and instruments that go first.

A program that notes times beside a load notes when the load let it run. The kernel stamps what comes at a socket when
it comes, whoever has the cores then: that is when a ground station on a computer of its own has it at its port.
Everything here is in nanoseconds of Unix time, the clock of those stamps.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import sys
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

STAMPED: Final = 35
"""SO_TIMESTAMPNS of Linux, which `socket` does not name."""
_TIMESPEC: Final = struct.Struct("@ll")
_ROOM: Final = socket.CMSG_SPACE(_TIMESPEC.size)
LARGEST: Final = 1 << 20
"""Most that is read at once [bytes]."""
DEEP: Final = 4 << 20
"""What a socket keeps while its reader is busy [bytes]."""
NS: Final = 1_000_000_000
"""A second."""


@dataclass(slots=True)
class Arrivals:
    """What came, and when.

    Attributes:
        at: for each attitude, when it came [ns], by what tells which it is.
        counts: messages of every kind, by the second in which they came.
    """

    at: dict[int, int] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)

    def came(self, at: int, number: int | None = None) -> None:
        """Note a message; `number` tells which attitude it is, where it is one."""
        self.counts[at // NS] += 1
        if number is not None:
            self.at.setdefault(number, at)

    def as_fields(self) -> dict[str, Any]:
        """As JSON has them."""
        return {"at": list(self.at.items()), "counts": list(self.counts.items())}

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Arrivals:
        """Those that `as_fields` wrote."""
        return cls(dict(fields["at"]), Counter(dict(fields["counts"])))


def stamp_arrivals(where: socket.socket) -> None:
    """Let the kernel stamp what comes at a socket.

    Args:
        where: a socket; a stream has for each read the stamp of its last part.
    """
    where.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, DEEP)
    where.setsockopt(socket.SOL_SOCKET, STAMPED, 1)


def receive(where: socket.socket) -> tuple[bytes, int]:
    """Read from a socket of `stamp_arrivals`.

    Returns:
        What came, and when it came at the socket [ns].

    Raises:
        OSError: nothing came in the socket's time, or nobody is there.
    """
    data, notes, _, _ = where.recvmsg(LARGEST, _ROOM)
    for level, kind, raw in notes:
        if level == socket.SOL_SOCKET and kind == STAMPED:
            seconds, rest = _TIMESPEC.unpack(raw[: _TIMESPEC.size])
            return data, seconds * NS + rest
    return data, time.time_ns()


def go_first() -> bool:
    """Put this thread, and those it starts, before every ordinary one; whether the system allows it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return False
    return True


def go_ordinary() -> None:
    """Take this thread back among the ordinary ones; those it has started stay where they are."""
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def be_instrument(work: Callable[[], None], result: Callable[[], Any]) -> None:
    """Work on a thread until standard input ends, then print the result as JSON and end the process.

    Args:
        work: goes on for ever; its end by an error ends the process with that error.
        result: what is told at the end.
    """

    def end(failed: threading.ExceptHookArgs) -> None:
        traceback.print_exception(failed.exc_value)
        os._exit(1)

    threading.excepthook = end
    threading.Thread(target=work, name="instrument", daemon=True).start()
    print("ready", flush=True)
    sys.stdin.read()
    print(json.dumps(result()), flush=True)
    os._exit(0)  # the thread still works, and a node of ROS takes seconds to leave
