"""`python -m tools.shape`: the shape of the source tree, printed and checked.

It prints how many lines each package has. It fails when a file or a function is too
long, when two modules of one package share a name, when more classes of the product share a name than today, or when a
package and a module in it import each other. Layers, and circles of neighbours, are import-linter's (`pyproject.toml`).
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Final

import grimp
from cyclopts import App, Parameter

from mkdaemon.cli.program import run
from mkdaemon.errors import MkError

LONGEST_FILE: Final = 600
"""Lines a file of src/, lab/ or tools/ may have."""
LONGEST_FUNCTION: Final = 60
"""Lines a function of such a file may have, from `def` to its end: a screen."""
FOLDERS: Final = ("src", "lab", "tools", "tests", "examples")
LIMITED: Final = ("src", "lab", "tools", "examples")
"""Folders whose files have the limits."""
SAME_CLASSES: Final = 3
"""Public classes of the product whose name another one has already. This number only goes down."""
PRODUCT: Final = ("mkdaemon", "mksim")
"""What is installed."""
WHOLE: Final = ("mksim",)
"""Packages without rooms: names are unique in all of them together."""
PROGRAMS: Final = ("mkdaemon.cli", "mkdaemon.gateways")
"""Each package in them is a separate program."""


def count_lines(root: Path) -> dict[str, int]:
    """Return the lines of every Python file of the tree, by its path from `root`."""
    files = sorted(path for folder in FOLDERS for path in (root / folder).rglob("*.py"))
    return {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8").count("\n") for path in files}


def package_of(path: str) -> str:
    """Return the package a file is counted in: `mkdaemon.link`, `mksim`, `lab`."""
    parts = path.split("/")
    if parts[0] != "src":
        return parts[0]
    return f"{parts[1]}.{parts[2]}" if len(parts) > 3 else parts[1]


def find_long_files(lines: Mapping[str, int]) -> list[str]:
    """Return a sentence for every file that is longer than it may be."""
    return [
        f"{path} has {count} lines; {LONGEST_FILE} are allowed"
        for path, count in lines.items()
        if path.split("/")[0] in LIMITED and count > LONGEST_FILE
    ]


def find_long_functions(root: Path) -> list[str]:
    """Return a sentence for every function that is longer than it may be."""
    faults = []
    for path in sorted(path for folder in LIMITED for path in (root / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
                count = node.end_lineno - node.lineno + 1
                if count > LONGEST_FUNCTION:
                    place = f"{path.relative_to(root).as_posix()}:{node.lineno}"
                    faults.append(f"{place} {node.name} has {count} lines; {LONGEST_FUNCTION} are allowed")
    return faults


def find_same_names(paths: Iterable[str]) -> list[str]:
    """Return a sentence for modules that share a name inside one package of the product.

    Args:
        paths: from the root of the tree.
    """
    places: dict[tuple[str, str], list[str]] = {}
    for path in sorted(paths):
        parts = path.split("/")
        if parts[0] != "src" or parts[-1] in {"__init__.py", "__main__.py"}:
            continue
        package = package_of(path)
        if package.partition(".")[0] in WHOLE:
            package = package.partition(".")[0]
        elif package in PROGRAMS and len(parts) > 4:
            package = f"{package}.{parts[3]}"
        places.setdefault((package, parts[-1]), []).append(path)
    return [
        f"{package} has {len(same)} modules of one name: {', '.join(same)}"
        for (package, _), same in places.items()
        if len(same) > 1
    ]


def same_classes(root: Path) -> dict[str, list[str]]:
    """Return the public classes of the product that share a name, each with the files that define one."""
    places: dict[str, list[str]] = {}
    for path in sorted(path for package in PRODUCT for path in (root / "src" / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(path.relative_to(root).as_posix())
    return {name: same for name, same in places.items() if len(same) > 1}


def find_same_classes(same: Mapping[str, Collection[str]], most: int = SAME_CLASSES) -> list[str]:
    """Return a sentence where classes share names more or less often than the budget says.

    Args:
        same: as `same_classes` finds them.
        most: the budget.
    """
    count = sum(len(files) - 1 for files in same.values())
    if count == most:
        return []
    if count < most:
        return [f"{count} classes share a name with another one: set SAME_CLASSES in tools/shape.py to {count}"]
    names = ", ".join(sorted(same, key=lambda name: (-len(same[name]), name)))
    return [f"{count} classes share a name with another one; {most} are allowed: give the new one its own ({names})"]


def find_circles(package: str) -> list[str]:
    """Return a sentence for each package that imports one of its own modules by which it is imported.

    Neighbours that import each other, each with all that is below it, are import-linter's to find.

    Args:
        package: importable package.
    """
    graph = grimp.build_graph(package, cache_dir=None)
    return [
        f"imports make a circle: {parent}, {module}"
        for parent in sorted(graph.modules)
        for module in sorted(graph.find_modules_directly_imported_by(parent) & graph.find_descendants(parent))
        if graph.find_shortest_chain(importer=module, imported=parent) is not None
    ]


def shape(*, root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path()) -> None:
    """Print the sizes of packages, and check files, functions, names and circles.

    Raises:
        MkError: a file or a function is too long, modules or classes share a name, or imports make a circle.
    """
    lines = count_lines(root)
    sizes = Counter[str]()
    for path, count in lines.items():
        sizes[package_of(path)] += count
    print("lines:", ", ".join(f"{package} {count}" for package, count in sizes.most_common()))
    faults = [*find_long_files(lines), *find_long_functions(root), *find_same_names(lines)]
    faults += find_same_classes(same_classes(root))
    faults += [circle for name in PRODUCT for circle in find_circles(name)]
    if faults:
        print(*faults, sep="\n")
        raise MkError(f"{len(faults)} faults of the shape")
    limits = f"no file above {LONGEST_FILE} lines, no function above {LONGEST_FUNCTION}"
    print(f"{limits}, no name twice in one package, no circle of imports; {SAME_CLASSES} classes share a name")


app = App(name="shape", default_command=shape, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
