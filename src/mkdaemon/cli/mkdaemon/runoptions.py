"""What the command line puts before the configuration file: the same for `run` and for `config show`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from mkdaemon.config.layers import Layered, load_layers
from mkdaemon.config.root import DaemonSections


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options that go before the configuration file."""

    port: Annotated[str | None, Parameter(name=["--port", "-p"])] = None
    """`/dev/ttyUSB0`, `/dev/serial/by-id/...`, `pty:/dev/pts/N`, `tcp:HOST:PORT` or `replay:FILE?speed=20`; goes
    before the file's `link.port`."""
    vehicle: str | None = None
    """Name in every key, `mk/<vehicle>/...`; goes before the file's `vehicle.name`. Without both a file and this option
    the environment's `MK_VEHICLE` counts, which names the vehicle that clients talk to."""
    listen: str | None = None
    """Zenoh endpoint for clients, for example `tcp/127.0.0.1:7448`; goes before the file's `bus.listen`."""
    wait: bool = False
    """Wait for the port if it is missing at the start, in place of ending; a recording waits for a subscriber."""
    real_time: bool = False
    """Go before other programs, as a service does by itself; docs/operations.md says what that can starve."""
    no_record: bool = False
    """Make no recording of this run; goes before the file's `record.enabled`."""

    def by_key(self) -> dict[str, Any]:
        """What was given, by dotted key."""
        given: dict[str, Any] = {
            "link.port": self.port,
            "vehicle.name": self.vehicle or None,
            "bus.listen": None if self.listen is None else [self.listen],
            "link.wait_for_port": True if self.wait else None,
            "control.real_time": True if self.real_time else None,
            "record.enabled": False if self.no_record else None,
        }
        return {key: value for key, value in given.items() if value is not None}


NONE_GIVEN: Final = RunOptions()


def load_configuration(
    config: Path | None,
    options: RunOptions,
    environment: Mapping[str, str] = os.environ,
    whole: type[DaemonSections] | None = None,
) -> Layered:
    """Read the configuration as `mkdaemon run` does; for `whole` see `load_layers`.

    Raises:
        ConfigError: a file, key or value is wrong.
    """
    return load_layers(config, options.by_key(), environment, whole)
