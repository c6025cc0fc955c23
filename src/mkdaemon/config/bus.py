"""Configuration of the Zenoh session."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mkdaemon.config.base import Section


class BusConfig(Section):
    """The Zenoh bus between daemon and clients."""

    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Zenoh endpoints to listen on. An endpoint that the network reaches must ask for a client certificate
    (docs/security.md) or a password; otherwise it is refused.

    If an endpoint is in use, the daemon ends at its start. Without an endpoint, clients reach it only through a router
    of `connect`."""
    allow_open: bool = False
    """Allow an endpoint through which every program in the network can fly; `mkctl status` and the log show it.

    With true, every program in the network can take the lease and fly."""
    connect: tuple[str, ...] = ()
    """Zenoh endpoints to connect to, for example a router that joins several machines.

    The daemon retries a missing router; clients behind it see no daemon."""
    zenoh_file: Path | None = None
    """A Zenoh configuration file (JSON5), for TLS and access control; `listen` and `connect` are added to it.

    With a wrong file the daemon ends at its start. Without one, traffic is not encrypted and clients are not
    authenticated."""
    lease: float = Field(default=2.0, ge=0.5, le=30.0)
    """A client whose session is silent for this long counts as gone [s].

    Longer detects a dead client later; shorter mistakes a client on a bad radio link for a dead one, and releases its
    aircraft."""
    max_queries: int = Field(default=64, ge=1, le=1024)
    """Queries processed at the same time; further ones get `busy`.

    Lower refuses queries of a busy ground station; higher lets a flood use memory."""
    local_group: str | None = None
    """Group that may use the Unix socket of `mkctl release`, in addition to the daemon's user; unset: none. The
    daemon's user must be in it.

    Its members can release the aircraft at any time, but do nothing else."""
