"""The daemon: opens the line and the bus, starts the tasks, wires them together."""

from mkdaemon.daemon.program import run

__all__ = ["run"]
