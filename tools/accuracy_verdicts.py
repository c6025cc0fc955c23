"""Words for what is measured beside a goal, and whether the goal is met."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

HONEST: Final = (0.7, 1.5)
"""NEES per degree of freedom."""


def verdict(*holds: bool) -> str:
    """Return whether a goal is met: all parts of it have to hold."""
    return "met" if all(holds) else "**missed**"


def honest_verdict(values: list[float]) -> str:
    """Return whether values of the NEES per degree of freedom are within `HONEST`, and how many are not."""
    least, most = HONEST
    beyond = sum(not least <= value <= most for value in values)
    return f"**missed** in {beyond} of {len(values)}" if beyond else "met"


def percent(share: float) -> str:
    """Return a share in percent, to a tenth."""
    return f"{100 * share:.1f}".removesuffix(".0")


def percents(shares: Iterable[float]) -> str:
    """Return the least and the largest of several shares."""
    every = list(shares)
    return f"{percent(min(every))}-{percent(max(every))} %"


def span(values: Iterable[float]) -> str:
    """Return the least and the largest of several values of the NEES."""
    every = list(values)
    return f"{min(every):.2f}-{max(every):.2f}"
