"""Which answer belongs to which request, where board and letter do not tell enough."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def same(name: str, answered: str = "", *, also: int | None = None) -> Callable[[Any, Any], bool]:
    """Return the test whether an answer carries the value the request named.

    Where the request or the answer has no such field, another layout or "there is none", the letter must do.

    Args:
        name: field of the request.
        answered: field of the answer; the same name where it is left out.
        also: a value of either that fits all.
    """

    def matches(asked: Any, came: Any) -> bool:
        wanted, found = getattr(asked, name, None), getattr(came, answered or name, None)
        return wanted is None or found is None or found == wanted or also in (wanted, found)

    return matches
