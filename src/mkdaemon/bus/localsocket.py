"""The daemon's Unix socket, an entry without Zenoh: its path and its protocol.

One request a connection: a line `VERB` or `VERB TEXT`, at most `REQUEST_BYTES` long. One answer: a `CommandResult` as a
line of JSON. The verbs are those of `VERBS`; they do, and refuse, the same as `do/<verb>`.
"""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from typing import Final

REQUEST_BYTES: Final = 1024
"""Longest request with its newline [bytes]."""
VERBS: Final = ("release", "cancel")
"""What can be asked for: to release the aircraft, and to end the procedure that runs, a motor test for example."""
SERVICE_FOLDER: Final = Path("/run/mkdaemon")
"""What systemd makes for the service (`RuntimeDirectory=`)."""
_PORT: Final = re.compile(r":(\d+)(?:[?#].*)?$")
_HOST: Final = re.compile(r"[a-z-]+/(?P<host>\[[^\]]*\]|[^:/?#]*)")
_THIS_MACHINE: Final = frozenset({"localhost", "[::1]", "0.0.0.0", "[::]"})


def socket_folders() -> tuple[Path, ...]:
    """Folders of the socket: a daemon takes the first, a client looks in all, systemd's included."""
    given = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    user = os.environ.get("XDG_RUNTIME_DIR")
    own = Path(user) / "mkdaemon" if user else Path(tempfile.gettempdir()) / f"mkdaemon-{os.getuid()}"
    return (*([Path(given)] if given else []), own, SERVICE_FOLDER)


def socket_name(vehicle: str, endpoint: str) -> str:
    """File name of the socket: one machine may run several daemons, on a port each."""
    port = _PORT.search(endpoint)
    return f"{vehicle}-{port[1]}.sock" if port else f"{vehicle}.sock"


def is_here(endpoint: str) -> bool:
    """Whether an endpoint is on this machine, so that the socket here belongs to the same aircraft."""
    host = _HOST.match(endpoint)
    return host is not None and (host["host"] in _THIS_MACHINE or host["host"].startswith("127."))
