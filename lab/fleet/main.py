"""`python -m lab fleet`: many aircraft on one Zenoh router, a link that is cut, and what each aircraft costs."""

from __future__ import annotations

import asyncio
import json
import os
import tempfile
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from lab.campaign import Row
from lab.fleet.cut import cut
from lab.fleet.network import enter_ground
from lab.fleet.scale import scale
from lab.tables import show
from mkdaemon.cli.arguments import AsJson, Length
from mkdaemon.errors import ConfigError, MkError


def main(
    *,
    case: Literal["cut", "scale"],
    vehicles: Annotated[str, Parameter(help="scale: numbers of aircraft, one after the other.")] = "1,5,10,20",
    seconds: Annotated[Length, Parameter(help="Length of the cut, or counted of each number of aircraft [s].")] = 12.0,
    results: Annotated[Path | None, Parameter(help="Put into this file: docs/results/fleet.json.")] = None,
    as_json: AsJson = False,
) -> int:
    """Cut the link of one aircraft of three (two minutes), or run many (a minute each, more on slow cores).

    The cut needs Linux, root and network namespaces. Exit code 1 where something is not as docs/lab/scale.md claims.

    Raises:
        ConfigError: namespaces are not permitted here; a number is wrong.
        MkError: the machine is too busy for it.
    """
    counts = counts_of(vehicles)
    with tempfile.TemporaryDirectory() as name:
        if case == "cut":
            enter_ground()
            try:
                row = asyncio.run(cut(Path(name), seconds))
            except TimeoutError:
                why = "the aircraft did not come up, or were not flown, in time: this machine is busy"
                raise MkError(why) from None
            shown = [{"what": claim, "holds": so} for claim, so in row["claims"].items()]
        else:
            rows = asyncio.run(scale(counts, seconds, Path(name)))
            machine = {"cores": len(os.sched_getaffinity(0)), "load_at_the_end": round(os.getloadavg()[0], 1)}
            row = {"rows": rows, "machine": machine, "holds": [one["vehicles"] for one in rows] == counts}
            shown = [{"what": f"{one['vehicles']} aircraft"} | one for one in rows]
    if results is not None:
        keep(results, case, row)
    return max(show(shown, ("what",), as_json=as_json, found=row), int(not row["holds"]))


def counts_of(text: str) -> list[int]:
    """Numbers of aircraft, as `--vehicles` has them.

    Raises:
        ConfigError: it is none.
    """
    words = text.split(",")
    if not all(word.strip().isdigit() and int(word) for word in words):
        raise ConfigError(f"--vehicles {text}: give numbers with commas, as 1,5,10,20")
    return [int(word) for word in words]


def keep(path: Path, case: str, row: Row) -> None:
    """Put a result into the file of results, in place of the one of that case."""
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    path.write_text(json.dumps({**known, case: row}, indent=1) + "\n", encoding="utf-8")
