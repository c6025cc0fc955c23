"""Which keys a pattern stands for."""

from __future__ import annotations


def matches(pattern: str, suffix: str) -> bool:
    """Whether a key, or a narrower pattern, is one that a pattern with `*` for some parts stands for."""
    wanted, found = pattern.split("/"), suffix.split("/")
    return len(wanted) == len(found) and all(a in {"*", b} for a, b in zip(wanted, found, strict=True))
