"""`mkdaemon bench vision`: the 2010 experiments and what has been asked for since, on rendered images.

Every figure is drawn from a seed set. `development` seeds were looked at while the code was tuned; `reporting` seeds,
the default and what docs/accuracy.md quotes, were not.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Annotated, Any, Final

import cv2
from cyclopts import Parameter

from mkdaemon.bench.vision_cases import accuracy, cold, conditions, view_angle
from mkdaemon.bench.vision_rates import rates
from mkdaemon.bench.vision_stills import SeedSet
from mkdaemon.bench.vision_truth import consistency, false_positives, flights, flips, photographs
from mkdaemon.errors import ConfigError

CASES: Final[dict[str, Callable[[bool, SeedSet], dict[str, Any]]]] = {
    "rates": rates,
    "cold": cold,
    "accuracy": accuracy,
    "view_angle": view_angle,
    "conditions": conditions,
    "flights": flights,
    "flips": flips,
    "false_positives": false_positives,
    "nees": consistency,
    "photographs": photographs,
}
"""The campaigns by name."""


def run_case(name: str, quick: bool, seeds: SeedSet) -> dict[str, Any]:
    """Run one campaign.

    Args:
        name: a key of `CASES`.
        quick: a fraction of the images.
        seeds: which scenes.

    Returns:
        Its figures and how long it took.

    Raises:
        ConfigError: there is no such case.
    """
    case = CASES.get(name)
    if case is None:
        msg = f"bench vision has no case '{name}': use one of {', '.join(CASES)}"
        raise ConfigError(msg)
    start = time.perf_counter()
    figures = case(quick, seeds)
    return {**figures, "seconds": round(time.perf_counter() - start, 1)}


def main(
    *,
    case: Annotated[str | None, Parameter(help="One campaign instead of all.")] = None,
    quick: Annotated[bool, Parameter(negative=(), help="A fraction of the images.")] = False,
    seeds: Annotated[SeedSet, Parameter(help="Which scenes.")] = SeedSet.REPORTING,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), help="One JSON object on the last line.")] = False,
) -> None:
    """Measure detection, accuracy and honesty of the vision on rendered images.

    Args:
        case: one campaign instead of all.
        quick: a fraction of the images.
        seeds: `reporting` scenes were never looked at during development.
        as_json: print one JSON object, on the last line.
    """
    cv2.setNumThreads(1)
    names = [case] if case is not None else list(CASES)
    results: dict[str, Any] = {"seeds": seeds.value, "quick": quick}
    for name in names:
        print(f"{name} ...", file=sys.stderr, flush=True)
        results[name] = run_case(name, quick, seeds)
        print(f"{name}: {results[name]['seconds']} s", file=sys.stderr, flush=True)
    print(json.dumps(results) if as_json else json.dumps(results, indent=2))
