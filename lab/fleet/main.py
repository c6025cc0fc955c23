"""`python -m lab fleet`: many aircraft on one Zenoh router, a link that is cut, and what each aircraft costs."""

from __future__ import annotations

import asyncio
import json
import os
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.fleet.cut import cut
from lab.fleet.network import enter_ground
from lab.fleet.radio import Air
from lab.fleet.scale import scale
from lab.tables import show
from mkdaemon.cli.arguments import AsJson, Length
from mkdaemon.errors import ConfigError, MkError

CASES: Final = ("cut", "scale")
MOST: Final = 200
"""Aircraft of one machine."""


def main(
    *,
    case: Annotated[str, Parameter(help="cut or scale.")],
    vehicles: Annotated[str, Parameter(help="scale: numbers of aircraft, one after the other.")] = "1,5,10,20",
    seconds: Annotated[Length, Parameter(help="Length of the cut, or counted of each number of aircraft [s].")] = 12.0,
    loss: Annotated[float, Parameter(help="cut: packets lost on that link, each way [%].")] = 5.0,
    delay_ms: Annotated[float, Parameter(help="cut: on that link, there and back [ms].")] = 60.0,
    seed: Annotated[int, Parameter(help="cut: of the losses.")] = 1,
    folder: Annotated[Path | None, Parameter(help="New folder that keeps configurations and recordings.")] = None,
    results: Annotated[Path | None, Parameter(help="Put into this file: docs/results/fleet.json.")] = None,
    as_json: AsJson = False,
) -> int:
    """Cut the link of one aircraft of three (two minutes), or run many (a minute each, more on slow cores).

    The cut needs Linux, root and network namespaces. Exit code 1 where something is not as docs/lab/scale.md claims.

    Raises:
        ConfigError: there is no such case; namespaces are not permitted here; a number is wrong.
        MkError: the machine is too busy for it.
    """
    if case not in CASES:
        raise ConfigError(f"--case {case}: there is {', '.join(CASES)}")
    counts = counts_of(vehicles)
    if folder is not None:
        folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory() if folder is None else nullcontext(str(folder.resolve())) as name:
        if case == "cut":
            enter_ground()
            try:
                findings = asyncio.run(cut(Path(name), seconds, Air(loss / 100, delay_ms / 2000), seed))
            except TimeoutError:
                raise MkError(
                    "the aircraft did not come up, or were not flown, in time: this machine is busy"
                ) from None
            row, holds = findings.row(), findings.holds
            shown = [{"what": claim, "holds": so} for claim, so in findings.claims().items()]
        else:
            rows = asyncio.run(scale(counts, seconds, Path(name)))
            row, holds = {"rows": rows, "machine": machine()}, [one["vehicles"] for one in rows] == counts
            shown = [{"what": f"{one['vehicles']} aircraft"} | one for one in rows]
    if results is not None:
        keep(results, case, row)
    return max(show(shown, ("what",), as_json=as_json, found=row), int(not holds))


def counts_of(text: str) -> list[int]:
    """Numbers of aircraft, as `--vehicles` has them.

    Raises:
        ConfigError: it is none.
    """
    words = text.split(",")
    if not all(word.strip().isdigit() and 0 < int(word) <= MOST for word in words):
        raise ConfigError(f"--vehicles {text}: give numbers from 1 to {MOST} with commas, as 1,5,10,20")
    return [int(word) for word in words]


def machine() -> dict[str, Any]:
    """What it was measured on."""
    return {"cores": len(os.sched_getaffinity(0)), "load_at_the_end": round(os.getloadavg()[0], 1)}


def keep(path: Path, case: str, row: dict[str, Any]) -> None:
    """Put a result into the file of results, in place of the one of that case."""
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    path.write_text(json.dumps({**known, case: row}, indent=1) + "\n", encoding="utf-8")
