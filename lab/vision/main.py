"""`python -m lab vision`: the 2010 experiments and what has been asked for since, on rendered images.

Every figure is drawn from a seed set. `development` seeds were looked at while the code was tuned; `reporting` seeds,
the default and what docs/lab/accuracy.md quotes, were not.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import cv2
from cyclopts import Parameter

from lab.vision.cases import ACCURACY, COLD, CONDITIONS, VIEW_ANGLE
from lab.vision.flights import FLOWN
from lab.vision.leaving import LEAVING
from lab.vision.parts import Case, Part, run_parts
from lab.vision.selfcal import SELFCAL
from lab.vision.stages import stages
from lab.vision.stills import SeedSet
from lab.vision.tagfree import FALSE_POSITIVES
from lab.vision.truth import PHOTOGRAPH_CASE
from mkdaemon.cli.arguments import AsJson
from mkdaemon.errors import ConfigError
from mkdaemon.files import write_whole

CASES: Final[dict[str, Case]] = {
    # One part: it runs in this process, alone, because what it measures is time.
    "stages": Case(
        lambda quick, seeds: [Part(stages, (quick, seeds), 1)], lambda _quick, _parts, found: dict(found[0])
    ),
    "cold": COLD,
    "accuracy": ACCURACY,
    "view_angle": VIEW_ANGLE,
    "conditions": CONDITIONS,
    **FLOWN,
    "leaving": LEAVING,
    "selfcal": SELFCAL,
    "false_positives": FALSE_POSITIVES,
    "photographs": PHOTOGRAPH_CASE,
}
"""The campaigns by name."""


def run_case(name: str, quick: bool, seeds: SeedSet, jobs: int = 1) -> dict[str, Any]:
    """Run one campaign.

    Args:
        name: a key of `CASES`.
        quick: a fraction of the images.
        seeds: which scenes.
        jobs: processes; the figures do not depend on it.

    Returns:
        Its figures, the first seed it may draw from, and how long it took.

    Raises:
        ConfigError: there is no such case.
        CampaignError: a process died.
    """
    case = CASES.get(name)
    if case is None:
        msg = f"lab vision has no case '{name}': use one of {', '.join(CASES)}"
        raise ConfigError(msg)
    start = time.perf_counter()
    parts = case.plan(quick, seeds)
    figures = case.sum_up(quick, parts, run_parts(name, parts, jobs))
    return {
        "base": seeds.base,
        **figures,
        "seconds": round(time.perf_counter() - start, 1),
        "jobs": min(jobs, len(parts)),
    }


def put_into(file: Path, found: dict[str, Any]) -> None:
    """Put the figures of whole campaigns into a file of results; those of other campaigns stay.

    Args:
        file: JSON, made if there is none.
        found: figures by campaign.

    Raises:
        ConfigError: the file is not a JSON object, or cannot be read or written.
    """
    try:
        kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        whole = {"seeds": SeedSet.REPORTING.value, "quick": False} | kept | found
        write_whole(file, json.dumps(whole) + "\n", overwrite=True)
    except (OSError, TypeError, ValueError) as error:
        msg = f"--into {file}: {error}; give a file that --into has written, or a new one"
        raise ConfigError(msg) from None


def main(
    *,
    case: Annotated[str | None, Parameter(help="One campaign instead of all.")] = None,
    quick: Annotated[bool, Parameter(negative=(), help="A fraction of the images.")] = False,
    seeds: Annotated[SeedSet | None, Parameter(help="Which scenes; `reporting` unless said.")] = None,
    jobs: Annotated[int | None, Parameter(help="Processes; as many as cores unless said.")] = None,
    into: Annotated[
        Path | None,
        Parameter(help="File of results that these are put into: docs/results/vision.json, then `make docs`."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure detection, accuracy and honesty of the vision on rendered images.

    About forty minutes with two processes, half of that for images without tags; `--quick` takes a fraction of the
    images, `--case` one campaign.

    Args:
        case: one campaign instead of all.
        quick: a fraction of the images.
        seeds: `reporting` scenes were never looked at during development.
        jobs: processes that share the images; the figures do not depend on it.
        into: JSON of whole campaigns on `reporting` seeds; what it has of other campaigns stays.
        as_json: print one JSON object, on the last line.

    Raises:
        ConfigError: no such case, no job at all, or `into` with less than whole campaigns on reporting seeds.
    """
    if jobs is not None and jobs < 1:
        msg = f"--jobs {jobs}: give 1 or more"
        raise ConfigError(msg)
    seeds = seeds or SeedSet.REPORTING
    if into is not None and (quick or seeds is not SeedSet.REPORTING):
        msg = f"--into {into}: it holds whole campaigns on reporting seeds; leave out --quick and --seeds"
        raise ConfigError(msg)
    cv2.setNumThreads(1)
    results = _measure([case] if case is not None else list(CASES), quick, seeds, jobs, into)
    print(json.dumps(results) if as_json else json.dumps(results, indent=2))


def _measure(names: Sequence[str], quick: bool, seeds: SeedSet, jobs: int | None, into: Path | None) -> dict[str, Any]:
    """Run campaigns one after the other, and keep the results of each when it ends."""
    results: dict[str, Any] = {"seeds": seeds.value, "quick": quick}
    for name in names:
        print(f"{name} ...", file=sys.stderr, flush=True)
        results[name] = run_case(name, quick, seeds, jobs or os.cpu_count() or 1)
        print(f"{name}: {results[name]['seconds']} s", file=sys.stderr, flush=True)
        if into is not None:
            put_into(into, {name: results[name]})
    return results
