"""The tables of docs/lab/mutants.md: what `python -m lab mutants --json` found, and why each survivor may live."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from tools.markdown import table

SHOWN: Final = 90
"""Characters of a line of code that are shown."""
Found = Mapping[str, Any]


def _summary(found: Found) -> Iterator[str]:
    planned = sum(min(found["sample"] or count, count) for count in found["of"].values())
    drawn = f"Of each subject {found['sample']} were drawn with seed {found['seed']}" if found["sample"] else "All"
    sizes = ", ".join(f"`{name.removeprefix('src/mkdaemon/')}` has {count}" for name, count in found["of"].items())
    total = (
        f"{drawn} ({sizes}): {found['killed']} of {found['mutants']} killed, {found['timeouts']} of these by time; "
        f"{found['equivalent']} do the same as the code. The verdicts took {found['seconds'] / 60:.0f} minutes of "
        "computing time."
    )
    if found["mutants"] < planned:
        total += f" The run was stopped before it came to the other {planned - found['mutants']} of its sample."
    if found["budget"]:
        total += f" Tests of one mutant took {found['budget']:g} s at most."
    yield total


def _survivors(found: Found) -> Iterator[str]:
    rows = (
        (
            _code(survivor["id"].removeprefix("src/mkdaemon/")),
            _code(survivor["was"]),
            _code(survivor["becomes"]),
            ("the same: " if survivor["equivalent"] else "") + (survivor["reason"] or "no test yet"),
        )
        for survivor in found["survivors"]
    )
    return table(("mutant", "was", "becomes", "reason"), rows)


def _subjects(found: Found) -> Iterator[str]:
    rows = (
        (
            what.removeprefix("src/mkdaemon/"),
            *(str(count[word]) for word in ("mutants", "killed", "equivalent", "survived")),
            f"{100 * count['share']:.1f} %",
        )
        for what, count in found["subjects"].items()
    )
    return table(("subject", "mutants", "killed", "the same", "survived", "share"), rows)


def _code(text: str) -> str:
    return f"`{text if len(text) <= SHOWN else text[: SHOWN - 3] + '...'}`"


TABLES: Final[Mapping[str, Callable[[Found], Iterator[str]]]] = {
    "summary": _summary,
    "subjects": _subjects,
    "survivors": _survivors,
}
"""By the names that the page gives them."""
