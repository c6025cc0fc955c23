"""The frozen base of every value that crosses the bus."""

from __future__ import annotations

from typing import ClassVar

from pydantic import ConfigDict

from mkdaemon.described import Described
from mkdaemon.stamp import Stamp


class Telemetry(Described):
    """A frozen SI value; ENU world, FLU body. Receivers ignore fields they do not know.

    Attributes:
        schema_version: raised only when a change breaks old readers; part of the encoding on the bus.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)
    schema_version: ClassVar[int] = 1


class Stamped(Telemetry):
    """A value that is true of one moment."""

    stamp: Stamp
    """The moment, on both clocks."""


class Command(Described):
    """A frozen value someone asks us to act on: strict types, closed fields, no NaN, no infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
    schema_version: ClassVar[int] = 1
