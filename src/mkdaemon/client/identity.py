"""The name by which others know this program."""

from __future__ import annotations

import getpass
import os
import socket


def client_name() -> str:
    """A name for this program that no other has: user, machine, process."""
    raw = f"{getpass.getuser()}-{socket.gethostname()}-{os.getpid()}"
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in raw)[:64]
