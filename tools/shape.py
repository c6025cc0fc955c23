"""`python -m tools.shape`: the shape of the source tree, printed and checked.

It prints how many lines each package has and which files are the longest. It fails when a file is too long or when
modules import each other in a circle. The layers are held by import-linter (`pyproject.toml`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import grimp
from cyclopts import App, Parameter
from rich.console import Console
from rich.table import Table

from mkdaemon.cli.program import run
from mkdaemon.errors import MkError

LONGEST_FILE: Final = 600
"""Lines a file of src/, lab/ or tools/ may have."""
FOLDERS: Final = ("src", "lab", "tools", "tests")
PRODUCT: Final = ("mkdaemon", "mksim")
"""Packages of `src/`."""
LIMITED: Final = ("src", "lab", "tools")
"""Folders whose files have the limit."""


@dataclass(frozen=True, slots=True)
class Package:
    """Size of a package of the product, or of a folder beside it.

    Attributes:
        name: as imported.
        files: how many.
        lines: of all of them.
    """

    name: str
    files: int
    lines: int


def count_lines(root: Path) -> dict[str, int]:
    """Return the lines of every Python file of the tree, by its path from `root`."""
    files = sorted(path for folder in FOLDERS for path in (root / folder).rglob("*.py"))
    return {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8").count("\n") for path in files}


def measure_packages(lines: Mapping[str, int]) -> list[Package]:
    """Return the packages of `src/`, modules above them together, and the other folders, each group largest first."""
    groups: dict[str, list[int]] = {}
    for path, count in lines.items():
        parts = path.split("/")
        name = ".".join(parts[1:-1][:2]) if parts[0] == "src" else parts[0]
        groups.setdefault(name, []).append(count)
    packages = [Package(name, len(counts), sum(counts)) for name, counts in groups.items()]
    return sorted(packages, key=lambda package: (not is_product(package), -package.lines))


def is_product(package: Package) -> bool:
    """Return whether a package is in the wheel."""
    return package.name.partition(".")[0] in PRODUCT


def find_long_files(lines: Mapping[str, int]) -> list[str]:
    """Return a sentence for every file that is longer than it may be."""
    return [
        f"{path} has {count} lines; {LONGEST_FILE} are allowed"
        for path, count in lines.items()
        if path.split("/")[0] in LIMITED and count > LONGEST_FILE
    ]


def find_circles(*packages: str) -> list[list[str]]:
    """Return the circles of imports in packages.

    Two kinds count: modules that import each other, and neighbours in one package (modules or packages) that do when
    each stands for everything below it.

    Args:
        packages: importable packages; those of the product by default.

    Returns:
        Every circle once, its members sorted.
    """
    graph = grimp.build_graph(*(packages or PRODUCT), cache_dir=None)
    circles = _circles(graph.modules, graph.find_modules_directly_imported_by)
    for parent in sorted(graph.modules):
        children = graph.find_children(parent)
        owner = {module: child for child in children for module in {child} | graph.find_descendants(child)}
        imports: dict[str, set[str]] = {child: set() for child in children}
        for module, child in owner.items():
            reached = {owner[other] for other in graph.find_modules_directly_imported_by(module) if other in owner}
            imports[child] |= reached - {child}
        circles += [circle for circle in _circles(children, imports.__getitem__) if circle not in circles]
    return circles


def _circles(nodes: Collection[str], imported_by: Callable[[str], set[str]]) -> list[list[str]]:
    """Groups in which every node reaches every other: nodes that reach each other belong together."""
    reached = {node: _reach(node, imported_by) for node in nodes}
    groups: list[list[str]] = []
    for node in sorted(nodes):
        group = sorted(other for other in reached[node] if node in reached[other])
        if len(group) > 1 and group not in groups:
            groups.append(group)
    return groups


def _reach(start: str, imported_by: Callable[[str], set[str]]) -> set[str]:
    found, waiting = {start}, [start]
    while waiting:
        new = imported_by(waiting.pop()) - found
        found |= new
        waiting += new
    return found


def shape(*, root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path()) -> None:
    """Print the size of every package, and check the length of files and the circles of imports.

    Raises:
        MkError: a file is too long, or imports make a circle.
    """
    lines = count_lines(root)
    packages = measure_packages(lines)
    _print_sizes(packages, lines)
    faults = find_long_files(lines)
    faults += [f"imports make a circle: {', '.join(circle)}" for circle in find_circles()]
    if faults:
        raise MkError("; ".join(faults))
    print(f"no file above {LONGEST_FILE} lines, no circle of imports")


def _print_sizes(packages: list[Package], lines: Mapping[str, int]) -> None:
    table = Table("package", "files", "lines", "share", box=None)
    for column in table.columns[1:]:
        column.justify = "right"
    product = sum(package.lines for package in packages if is_product(package))
    for package in packages:
        share = f"{100 * package.lines / product:.1f} %" if is_product(package) else ""
        table.add_row(package.name, str(package.files), str(package.lines), share)
    console = Console()
    console.print(table)
    longest = sorted(((count, path) for path, count in lines.items() if path.startswith("src/")), reverse=True)[:3]
    console.print("longest: " + ", ".join(f"{path} {count}" for count, path in longest), soft_wrap=True)


app = App(name="shape", default_command=shape, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
