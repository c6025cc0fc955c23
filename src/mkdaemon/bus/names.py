"""Whole keys and their suffixes."""

from __future__ import annotations

from typing import Final

ROOT: Final = "mk"


def key(vehicle: str, suffix: str) -> str:
    """The whole key of a suffix."""
    return f"{ROOT}/{vehicle}/{suffix}"


def suffix_of(vehicle: str, whole: str) -> str:
    """What follows `mk/<vehicle>/` in a key.

    Raises:
        ValueError: the key belongs to another vehicle.
    """
    head = f"{ROOT}/{vehicle}/"
    if not whole.startswith(head):
        msg = f"{whole} is no key of vehicle {vehicle}"
        raise ValueError(msg)
    return whole[len(head) :]
