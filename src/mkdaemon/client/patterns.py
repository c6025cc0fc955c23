"""Patterns of keys: what can match a key that exists."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from functools import cache
from itertools import chain
from typing import TYPE_CHECKING, Final

import zenoh

from mkdaemon.errors import MkError

if TYPE_CHECKING:
    from pydantic import BaseModel

_FRAMES: Final = ("rx", "tx")
_LIKE: Final = 0.6
"""Share of letters in common from which a key is near to a pattern."""
_AS_LIKE: Final = 0.1
"""A key is named beside the nearest one if it is nearly as near."""


def require_known(pattern: str) -> None:
    """Make sure that a pattern can match a published key; a misspelt pattern would wait for ever.

    Args:
        pattern: key without `mk/<vehicle>/`; may hold `*` and `**`.

    Raises:
        MkError: no key matches; names the nearest one.
    """
    if not is_known(pattern):
        raise MkError(f"no key matches {pattern!r}{did_you_mean(pattern)}")


def is_known(pattern: str) -> bool:
    """Whether a pattern matches a key of the table of keys; frames count by board and message."""
    expression = zenoh.KeyExpr(pattern)
    # Frames come last: their keys need the table of messages, which takes a while to import.
    return any(expression.intersects(zenoh.KeyExpr(known)) for known in chain(_value_keys(), _frame_keys()))


def did_you_mean(pattern: str) -> str:
    """The keys nearest to a pattern as half a sentence; where none is near, what keys begin with."""
    roots = list(dict.fromkeys(known.partition("/")[0] for known in known_keys()))
    root, slash, rest = pattern.partition("/")
    corrected = (f"{other}{slash}{rest}" for other in difflib.get_close_matches(root, roots, n=1))
    near = [other for other in corrected if is_known(other)] or _nearest(pattern)
    if near:
        *others, last = near
        return f"; did you mean {', '.join(others)}{' or ' if others else ''}{last}?"
    return f"; keys begin with {', '.join(roots)}: docs/keys.md lists them all"


def _nearest(pattern: str) -> list[str]:
    """Up to three keys, the nearest first; a pattern of one word is compared with the last word of keys."""
    likeness: dict[str, float] = {}
    for known in known_keys():
        word = known if "/" in pattern else known.rpartition("/")[2]
        likeness[known] = difflib.SequenceMatcher(None, pattern, word).ratio()
    best = max(likeness.values())
    near = [known for known, ratio in likeness.items() if ratio >= max(_LIKE, best - _AS_LIKE)]
    return sorted(near, key=lambda known: -likeness[known])[:3]


@cache
def known_keys() -> tuple[str, ...]:
    """Every key that is published or streamed, without `mk/<vehicle>/`; names of cameras as `*`."""
    return (*_value_keys(), *_frame_keys())


def _value_keys() -> Iterator[str]:
    """Keys of everything but frames."""
    from mkdaemon.bus.keys import KEYS, Use

    for spec in KEYS:
        is_streamed = spec.use in {Use.PUBLISHED, Use.CLIENT, Use.SETPOINT}
        if is_streamed and spec.pattern.partition("/")[0] not in _FRAMES:
            yield spec.pattern


def _frame_keys() -> Iterator[str]:
    """Keys of frames: every message under each board it belongs to, and those no message fits."""
    from mkdaemon.protocol import MESSAGES, Board

    for way in _FRAMES:
        yield from dict.fromkeys(f"{way}/{board.word}/{cls.spec.key}" for (board, *_), cls in MESSAGES.items())
        yield from dict.fromkeys(f"{way}/{Board.ANY.word}/{cls.spec.key}" for cls in MESSAGES.values())
        yield from (f"{way}/{board}/unknown" for board in (*(board.word for board in Board), "other"))


def model_of(suffix: str) -> type[BaseModel] | None:
    """What a key carries; None where it is not a key, or carries no typed value."""
    from mkdaemon.bus.keys import find

    spec = find(suffix)
    return None if spec is None else spec.carries
