"""Whole keys and their suffixes."""

from __future__ import annotations

from typing import Final

ROOT: Final = "mk"


REPLAY: Final = "replay"
"""Root of everything that is played without a name of its own."""


def key(vehicle: str, suffix: str, root: str = ROOT) -> str:
    """The whole key of a suffix."""
    return f"{root}/{vehicle}/{suffix}"


def suffix_of(vehicle: str, whole: str, root: str = ROOT) -> str:
    """What follows `<root>/<vehicle>/` in a key.

    Raises:
        ValueError: the key belongs to another vehicle.
    """
    head = f"{root}/{vehicle}/"
    if not whole.startswith(head):
        msg = f"{whole} is no key of vehicle {vehicle}"
        raise ValueError(msg)
    return whole[len(head) :]
