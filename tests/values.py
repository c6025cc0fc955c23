"""Values of the daemon, as short as they can be written."""

from __future__ import annotations

from enum import Enum
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel

from mkdaemon.stamp import Stamp

Made = TypeVar("Made", bound=BaseModel)

LEVEL = (1.0, 0.0, 0.0, 0.0)
"""No rotation."""
STAMP = Stamp(monotonic=100.5, wall=1_700_000_000.25)


def made(kind: type[Made], stamp: Stamp = STAMP, **fields: Any) -> Made:
    """A value of a class in which nothing is wrong with what is not given: zero, level, empty, unknown.

    Args:
        kind: the class.
        stamp: of the value.
        fields: what is to be seen in it.
    """
    needed = {name: info.annotation for name, info in kind.model_fields.items() if info.is_required()}
    blank = {name: LEVEL if name.startswith("quaternion") else _blank(needed[name], stamp) for name in needed}
    return kind(**blank | fields)


def _blank(kind: Any, stamp: Stamp) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return None if NoneType in parts else _blank(parts[0], stamp)
    if origin is Literal:
        return parts[0]
    if origin is tuple:
        return () if ... in parts else tuple(_blank(part, stamp) for part in parts)
    if kind is Stamp:
        return stamp
    if issubclass(origin or kind, Enum):
        return next(iter(kind))
    return made(kind, stamp) if issubclass(origin or kind, BaseModel) else (origin or kind)()
