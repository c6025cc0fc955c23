"""The frozen base of every configuration section."""

from __future__ import annotations

from typing import Final

from pydantic import ConfigDict

from mkdaemon.described import Described


class Reloadable:
    """Marks a key that a running daemon reloads: `Annotated[int, RELOADABLE]`; every other needs a restart."""


RELOADABLE: Final = Reloadable()


class Section(Described):
    """A frozen, closed configuration section: unknown keys, infinities and NaN are errors; defaults are documented.

    The docstring below a field is its meaning, with the unit in brackets, and, after an empty line, what a wrong value
    does.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
