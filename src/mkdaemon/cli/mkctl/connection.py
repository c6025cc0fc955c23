"""Options of every command: which vehicle, and where its daemon is."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter

from mkdaemon.cli.printing import show
from mkdaemon.client import Vehicle, connect
from mkdaemon.client.connection import DEFAULT_ENDPOINT, DEFAULT_VEHICLE


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class Connection:
    """Which vehicle, and where its daemon is."""

    vehicle: Annotated[str, Parameter(env_var="MK_VEHICLE")] = DEFAULT_VEHICLE
    """Name of the vehicle."""
    connect: Annotated[str, Parameter(env_var="MK_CONNECT")] = DEFAULT_ENDPOINT
    """Zenoh endpoint of the daemon or of a router."""
    zenoh_file: Annotated[Path | None, Parameter(env_var="MK_ZENOH_FILE")] = None
    """Zenoh configuration of this client, for TLS: docs/security.md."""
    json: bool = False
    """Print JSON, one object a line, in place of text."""

    def open(self) -> AbstractAsyncContextManager[Vehicle]:
        """Connect to it."""
        return connect(self.vehicle, self.connect, zenoh_file=self.zenoh_file)

    def show(self, fields: object, words: str) -> None:
        """Print what a command found: one JSON value where that is wanted, else words."""
        show(fields, words, as_json=self.json)


HERE: Final = Connection()
"""The default of every command's `connection`: this machine, or what the environment says."""
