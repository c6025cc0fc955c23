"""The frozen base of every value that crosses the bus.

The validators of a class are built when it is used first: for all of them it takes 0.2 s, a third of the processor time
of a command like `mkctl status`. A daemon builds them before it flies (`build_models`). The modules of this package
evaluate their annotations: strings, which pydantic compiles one by one, cost such a command another 0.04 s.
"""

from functools import cache
from typing import ClassVar

from pydantic import ConfigDict

from mkdaemon.described import Described
from mkdaemon.stamp import Stamp


@cache
def build_models() -> None:
    """Build the validators of every value that is imported, so that none is built in flight."""
    waiting: list[type[Described]] = [Telemetry, Command]
    while waiting:
        model = waiting.pop()
        model.model_rebuild()
        waiting += model.__subclasses__()


class Telemetry(Described):
    """A frozen SI value; ENU world, FLU body. Receivers ignore fields they do not know.

    Attributes:
        schema_version: raised only when a change breaks old readers; part of the encoding on the bus.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False, defer_build=True)
    schema_version: ClassVar[int] = 1


class Stamped(Telemetry):
    """A value that is true of one moment."""

    stamp: Stamp
    """Time of the value, on both clocks."""


class Command(Described):
    """A frozen value someone asks us to act on: strict types, closed fields, no NaN, no infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)
    schema_version: ClassVar[int] = 1
