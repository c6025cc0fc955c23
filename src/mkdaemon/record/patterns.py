"""Patterns of keys, as Zenoh has them: `*` is one part between slashes, `**` any number of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache


def matches_any(key: str, patterns: Sequence[str]) -> bool:
    """Whether a key, with or without `mk/<vehicle>/`, matches one of the patterns; with no patterns every key does.

    Args:
        key: the whole key.
        patterns: with or without `mk/<vehicle>/`.
    """
    suffix = key.partition("/")[2].partition("/")[2]
    return not patterns or any(_compiled(one).fullmatch(name + "/") for one in patterns for name in (key, suffix))


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    """The pattern of a key with a slash behind it."""
    chunks = [_chunk(one) for one in pattern.split("/")]
    return re.compile("".join(chunks))


def _chunk(chunk: str) -> str:
    return "(?:[^/]+/)*" if chunk == "**" else re.escape(chunk).replace(r"\*", "[^/]*") + "/"
