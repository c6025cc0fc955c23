"""`python -m tools.floor`: covered branches of the packages that fly, printed and held above a floor.

It reads the JSON report that `make test` writes; see `tools.branches`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import App, Parameter

from mkdaemon.cli.program import run
from mkdaemon.errors import ConfigError, MkError

FLOOR: Final = 0.95
"""Share of the branches of every package that the tests must take."""
MOST_FILES: Final = 5
"""Files named of a package that is below the floor."""


@dataclass(frozen=True, slots=True)
class Cover:
    """What the tests covered of a package.

    Attributes:
        package: folder under `src/mkdaemon`.
        branches: how many there are.
        covered: how many were taken.
        missing: branches not taken, by file.
    """

    package: str
    branches: int
    covered: int
    missing: Mapping[str, int]

    @property
    def share(self) -> float:
        """Share of the branches taken; 1 where there are none."""
        return self.covered / self.branches if self.branches else 1.0


def read_covers(report: Mapping[str, Any]) -> list[Cover]:
    """Return the packages of a report of `tools.branches`, by name."""
    found: dict[str, dict[str, tuple[int, int]]] = {}
    for path, file in report["files"].items():
        package, _, inside = path.rpartition("mkdaemon/")[2].partition("/")
        total = file["summary"]
        found.setdefault(package, {})[inside] = (total["num_branches"], total["covered_branches"])
    return [
        Cover(
            package,
            sum(branches for branches, _ in files.values()),
            sum(covered for _, covered in files.values()),
            {name: branches - covered for name, (branches, covered) in files.items() if branches > covered},
        )
        for package, files in sorted(found.items())
    ]


def floor(
    report: Annotated[Path, Parameter(help="Report of tools.branches.")] = Path("build/branches.json"),
) -> None:
    """Print how many branches are covered, package by package, and compare them with the floor.

    Raises:
        ConfigError: there is no such report.
        MkError: a package is below the floor.
    """
    if not report.is_file():
        msg = f"{report}: no such report; `make test` writes it"
        raise ConfigError(msg)
    covers = read_covers(json.loads(report.read_text(encoding="utf-8")))
    for cover in covers:
        print(f"{cover.package:10} {100 * cover.share:5.1f} % of {cover.branches} branches")
    low = [cover for cover in covers if cover.share < FLOOR]
    if low:
        raise MkError("; ".join(_complaint(cover) for cover in low))


def _complaint(cover: Cover) -> str:
    worst = sorted(cover.missing.items(), key=lambda item: -item[1])[:MOST_FILES]
    places = ", ".join(f"{name} ({count})" for name, count in worst)
    shares = f"{100 * cover.share:.1f} % of the branches, {100 * FLOOR:g} % are needed"
    return f"{cover.package}: {shares}; missing in {places}"


app = App(name="floor", default_command=floor, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
