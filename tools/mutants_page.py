"""docs/lab/mutants.md: what `python -m lab mutants --json` found, and why each survivor may live."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tools.markdown import table

RESULTS: Final = Path("docs/results/mutants.json")
SHOWN: Final = 90
"""Characters of a line of code that are shown."""

_HEAD: Final = """# Mutants

`python -m lab mutants` changes the code that decides, one place at a time (a comparison, a constant, a sign, a
condition, a value returned, a statement left out), and runs the tests that come by. A mutant is killed when a test
fails or takes too long. What survives is a missing test, or changes nothing that matters: then its reason stands
below and in `lab/mutants/survivors.toml`. The share leaves out mutants that do the same as the code.

A mutant that is killed takes about 0.1 s of computing time, one that lives all its tests, up to `--budget`. Tests that
tell most in the least time come first. Waiting for a processor does not count against a mutant, and a kill by a test
that waits is tried again: a loaded machine kills nothing. Verdicts are kept in `build/mutants`, so a run that was
stopped goes on, and after new tests a survivor has to outlive only those.

```sh
python -m lab mutants src/mkdaemon/control/sight.py                         # one file, all its mutants
python -m lab mutants --sample 400 --budget 25 --jobs 2 --json > docs/results/mutants.json
python -m tools.docs                                                        # makes this page of it
```
"""


def mutants_page(root: Path) -> str:
    """Return the page.

    Args:
        root: root of the source tree.
    """
    found: dict[str, Any] = json.loads((root / RESULTS).read_text(encoding="utf-8").splitlines()[-1])
    planned = sum(min(found["sample"] or count, count) for count in found["of"].values())
    drawn = f"Of each subject {found['sample']} were drawn with seed {found['seed']}" if found["sample"] else "All"
    sizes = ", ".join(f"`{name.removeprefix('src/mkdaemon/')}` has {count}" for name, count in found["of"].items())
    total = (
        f"{drawn} ({sizes}): {found['killed']} of {found['mutants']} killed, {found['timeouts']} of these by time; "
        f"{found['equivalent']} do the same as the code. At first verdict, before tests were written for the "
        f"survivors of this sample, {found['killed_first']} were killed ({100 * found['share_first']:.1f} %). "
        f"The last verdicts took {found['seconds'] / 60:.0f} minutes of computing time."
    )
    if found["mutants"] < planned:
        total += (
            f" The run was stopped before it came to the other {planned - found['mutants']} of its sample; "
            "what runs at import (tables, constants) comes last."
        )
    if found["budget"]:
        total += f" Tests of one mutant took {found['budget']:g} s at most."
    if found["tests"]:
        count = len(found["tests"])
        total += f" Only {count} files and folders of tests judged, named in the results: shares are lower bounds."
    tables = (("subject", "subjects"), ("file", "files"), ("change", "operators"))
    lines = [_HEAD, total]
    for name, key in tables:
        lines += ["", *_counts(name, found[key])]
    rows = (
        (
            _code(survivor["id"].removeprefix("src/mkdaemon/")),
            _code(survivor["was"]),
            _code(survivor["becomes"]),
            ("the same: " if survivor["equivalent"] else "") + (survivor["reason"] or "no test yet"),
        )
        for survivor in found["survivors"]
    )
    lines += ["\n## Survivors\n", *table(("mutant", "was", "becomes", "reason"), rows)]
    return "\n".join(lines) + "\n"


def _counts(name: str, counts: dict[str, dict[str, Any]]) -> Iterator[str]:
    rows = (
        (
            key.removeprefix("src/mkdaemon/"),
            *(str(count[word]) for word in ("mutants", "killed", "equivalent", "survived")),
            f"{100 * count['share_first']:.1f} %",
            f"{100 * count['share']:.1f} %",
        )
        for key, count in counts.items()
    )
    return table((name, "mutants", "killed", "the same", "survived", "share at first", "share"), rows)


def _code(text: str) -> str:
    return f"`{text if len(text) <= SHOWN else text[: SHOWN - 3] + '...'}`"
