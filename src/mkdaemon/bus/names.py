"""Whole keys and their suffixes."""

from __future__ import annotations

from typing import Final

WILDCARD: Final = "*"
"""In every key expression that stands for more than one key; no key has it."""
ROOT: Final = "mk"


REPLAY: Final = "replay"
"""Root of everything that is played without another name."""


def key(vehicle: str, suffix: str, root: str = ROOT) -> str:
    """The whole key of a suffix."""
    return f"{root}/{vehicle}/{suffix}"


def suffix_of(vehicle: str, whole: str, root: str = ROOT) -> str:
    """The part after `<root>/<vehicle>/` of a key.

    Raises:
        ValueError: the key belongs to another vehicle.
    """
    head = f"{root}/{vehicle}/"
    if not whole.startswith(head):
        msg = f"{whole} is not a key of vehicle {vehicle}"
        raise ValueError(msg)
    return whole[len(head) :]


def received_suffix(vehicle: str, whole: str, root: str = ROOT) -> str | None:
    """The part after `<root>/<vehicle>/` of a received key.

    Returns:
        None if it names no key of this vehicle: programs may put to a wildcard, `mk/**`, and it arrives as such.
    """
    head = f"{root}/{vehicle}/"
    return whole[len(head) :] if whole.startswith(head) and WILDCARD not in whole else None


def received_vehicle(whole: str) -> str | None:
    """The vehicle in the key of something that arrived; None where it names none."""
    chunks = whole.split("/")
    return None if WILDCARD in whole or len(chunks) < 3 else chunks[1]
