"""`python -m lab compare`: what became of the same flights before and after, pair by pair.

Two files of results, or two source trees in which the same campaign is carried out. Flights are paired by their keys,
so that a figure is of the same seeds, and one flight that ends differently is not hidden by the sums.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from rich.table import Table

from lab.campaign import CampaignError, Ending, Results, Row
from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import Console
from mkdaemon.errors import ConfigError

STDERR: Final = 2
"""Where the campaigns in the trees write: stdout may be JSON."""


def main(before: Path, after: Path, *campaign: str, as_json: AsJson = False) -> int:
    """Compare results of campaigns flight by flight; exit code 1 if a flight finished before and does not after.

    Args:
        before: a file of `--results`, or a source tree.
        after: the same kind.
        campaign: of two trees: what is carried out in both, for example `-- demo --seeds 20 --loss 0.05`.

    Raises:
        ConfigError: a file and a tree, trees without a campaign, or files that have no flight in common.
        CampaignError: a campaign in a tree kept no results.
    """
    if before.is_dir() != after.is_dir() or (before.is_dir() and not campaign):
        msg = (
            "lab compare: give two files of --results, or two source trees and, behind --, a campaign with its options"
        )
        raise ConfigError(msg)
    old, new = (results_in(tree, campaign) if tree.is_dir() else Results(tree) for tree in (before, after))
    found = {name: compared(old.by_key(name), new.by_key(name)) for name in old.rows if name in new.rows}
    found = {name: each for name, each in found.items() if each["pairs"]}
    if not found:
        raise ConfigError(f"lab compare: {before} and {after} have no flight in common")
    if as_json:
        print(json.dumps(found))
    else:
        for name, each in found.items():
            _print(name, each)
    return 1 if any(each["worse"] for each in found.values()) else 0


def results_in(tree: Path, campaign: Sequence[str]) -> Results:
    """Carry out a campaign with the sources of a tree and this Python.

    Raises:
        CampaignError: it kept no results.
    """
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder) / "results.jsonl"
        tree = tree.resolve()
        environment = {**os.environ, "PYTHONPATH": f"{tree / 'src'}{os.pathsep}{tree}"}
        words = [sys.executable, "-m", "lab", *campaign, "--results", str(kept)]
        subprocess.run(words, cwd=tree, env=environment, check=False, stdout=STDERR)
        if not kept.exists():
            raise CampaignError(f"{tree}: lab {' '.join(campaign)} kept no results; run it there to see why")
        return Results(kept)


def compared(before: Mapping[str, Row], after: Mapping[str, Row]) -> dict[str, Any]:
    """The flights that both have.

    Returns:
        `pairs`: how many; `endings`: how often each ending became each other one; `worse` and `better`: keys of flights
        that finished on one side only; `figures`: of every number, the medians before, after, and of the differences.
    """
    keys = [key for key in before if key in after]
    changes = Counter((_ending(before[key]), _ending(after[key])) for key in keys)
    finished = {key: tuple(_ending(rows[key]) == Ending.FINISHED for rows in (before, after)) for key in keys}
    figures = {}
    for name in dict.fromkeys(name for key in keys for name in after[key]):
        sides = [(before[key].get(name), after[key].get(name)) for key in keys]
        pairs: list[tuple[Any, Any]] = [side for side in sides if all(map(_is_number, side))]
        if pairs:
            columns = ([old for old, _ in pairs], [new for _, new in pairs], [new - old for old, new in pairs])
            figures[name] = dict(zip(("before", "after", "difference"), map(median, columns), strict=True))
    return {
        "pairs": len(keys),
        "endings": {f"{old} -> {new}": count for (old, new), count in sorted(changes.items())},
        "worse": [key for key, (was, is_now) in finished.items() if was and not is_now],
        "better": [key for key, (was, is_now) in finished.items() if is_now and not was],
        "figures": figures,
    }


def _ending(row: Row) -> str:
    return str(row.get("ending", Ending.FINISHED))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _print(name: str, found: Mapping[str, Any]) -> None:
    table = Table("figure", "before", "after", "median difference", title=f"{name}: {found['pairs']} pairs")
    for figure, values in found["figures"].items():
        table.add_row(figure, *(f"{values[side]:.3g}" for side in ("before", "after", "difference")))
    Console().print(table)
    for change, count in found["endings"].items():
        print(f"  {count} times {change}")
    for side in ("worse", "better"):
        for key in found[side]:
            print(f"  {side}: {key}")
