"""Changes of a configuration file that a running daemon applies, and those that need a restart."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

from pydantic import BaseModel

from mkdaemon.config.base import Reloadable
from mkdaemon.config.root import Config

_Model = TypeVar("_Model", bound=BaseModel)


class Reload(NamedTuple):
    """Result of a changed configuration.

    Attributes:
        cfg: the running one with all that can be taken up.
        taken: dotted keys that are.
        waiting: dotted keys that differ and need a restart; a list of tables counts as one.
    """

    cfg: Config
    taken: tuple[str, ...]
    waiting: tuple[str, ...]


def plan_reload(running: Config, wanted: Config) -> Reload:
    """Compare two configurations, and take what a running daemon can take; the simulator's section is not its own."""
    taken: list[str] = []
    waiting: list[str] = []
    cfg = _merged(running, wanted.model_copy(update={"sim": running.sim}), "", taken, waiting)
    return Reload(cfg, tuple(taken), tuple(waiting))


def _merged(running: _Model, wanted: _Model, section: str, taken: list[str], waiting: list[str]) -> _Model:
    changes: dict[str, Any] = {}
    for name, info in type(running).model_fields.items():
        dotted = f"{section}.{name}" if section else name
        old, new = getattr(running, name), getattr(wanted, name)
        if isinstance(old, BaseModel) and isinstance(new, BaseModel):
            changes[name] = _merged(old, new, dotted, taken, waiting)
        elif old != new and any(isinstance(mark, Reloadable) for mark in info.metadata):
            taken.append(dotted)
            changes[name] = new
        elif old != new:
            waiting.append(dotted)
    return running.model_copy(update=changes)
