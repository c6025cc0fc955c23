"""Configuration of the Zenoh session."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mkdaemon.config.base import Section


class BusConfig(Section):
    """The Zenoh bus between daemon and clients."""

    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Zenoh endpoints to listen on. What the network reaches and asks for no client certificate (docs/security.md) and
    no password is refused.

    An endpoint in use ends the daemon at its start. Without one, clients meet it over a router of `connect` alone."""
    allow_open: bool = False
    """Listen even if every program in the network could fly; `mkctl status` and the log then say so.

    True lets every program in the network take the lease and fly."""
    connect: tuple[str, ...] = ()
    """Zenoh endpoints to connect to, for example a router that joins several machines.

    A router that is not there is tried again and again; clients behind it see no daemon."""
    zenoh_file: Path | None = None
    """A Zenoh configuration file (JSON5), for TLS and access control; `listen` and `connect` are added to it.

    A wrong file ends the daemon at its start; without one nothing is encrypted and clients are not authenticated."""
    lease: float = Field(default=2.0, ge=0.5, le=30.0)
    """A client whose session is silent for this long counts as gone [s].

    Longer notices a dead client later; shorter takes a client on a bad radio link for dead, and releases its
    aircraft."""
    max_queries: int = Field(default=64, ge=1, le=1024)
    """Queries worked on at a time; further ones are answered `busy`.

    Lower refuses questions of a busy ground station; higher lets a flood take memory."""
    local_group: str | None = None
    """Group whose members may use the Unix socket for `mkctl release` beside the daemon's own user; unset: none.
    The daemon's user must be in it.

    Members may release the aircraft at any moment, and nothing else."""
