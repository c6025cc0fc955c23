"""Sentences that are filled in with words, also where a word is missing."""

from typing import Any


class _Missing(str):
    """Stands for a word that was not given, whatever the format it should have had."""

    __slots__ = ()

    def __format__(self, spec: str) -> str:
        return f"({self!s})"


class KnownWords(dict[str, Any]):
    """Words for `str.format_map`; one that was not given stands in brackets under its own name."""

    def __missing__(self, key: str) -> str:
        return _Missing(key)
