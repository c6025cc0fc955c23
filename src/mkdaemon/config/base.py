"""The frozen base of every configuration section."""

from __future__ import annotations

from pydantic import ConfigDict

from mkdaemon.described import Described


class Section(Described):
    """A frozen, closed configuration section: unknown keys, infinities and NaN are errors; defaults are documented."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
