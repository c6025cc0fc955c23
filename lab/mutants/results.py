"""What became of mutants, summed up, and the survivors with a reason each."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from lab.campaign import Row
from lab.mutants.operators import Mutant
from mkdaemon.errors import ConfigError

REASONS: Final = Path("lab/mutants/survivors.toml")
"""Mutants that no test kills, and why that is right; from the root of the tree."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a mutant may survive.

    Attributes:
        path: of the file, from the root of the tree.
        scope: qualified name of the function it is in.
        was: what stands there.
        becomes: what the mutant makes of it.
        reason: why no test can or need notice.
        is_equivalent: the mutant does the same as the code; it does not count.
    """

    path: str
    scope: str
    was: str
    becomes: str
    reason: str
    is_equivalent: bool = False


def read_reasons(file: Path) -> list[Reason]:
    """Read the reasons.

    Raises:
        ConfigError: it cannot be read, or a word is missing or unknown.
    """
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        return [Reason(**entry) for entry in content.get("survivor", ())]
    except (OSError, TypeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{file}: {error}") from None


def sum_up(
    mutants: Sequence[Mutant],
    verdicts: Mapping[str, Row],
    reasons: Sequence[Reason],
    subject_of: Callable[[str], str] = str,
) -> dict[str, Any]:
    """Count.

    Args:
        mutants: those that were tried.
        verdicts: of all of them, by id.
        reasons: of those that may survive.
        subject_of: what a file belongs to.

    Returns:
        Counts in all and by subject; each survivor with its reason, empty where nobody wrote one. The shares killed
        leave out the equivalent ones, and only those.
    """
    known = {(reason.path, reason.scope, reason.was, reason.becomes): reason for reason in reversed(reasons)}
    survivors: dict[str, dict[str, Any]] = {}
    for mutant in mutants:
        if verdicts[mutant.id]["outcome"] == "survived":
            reason = known.get((mutant.path, mutant.scope, mutant.was, mutant.becomes))
            words = {"id": mutant.id, "scope": mutant.scope, "was": mutant.was, "becomes": mutant.becomes}
            survivors[mutant.id] = words | {
                "reason": reason.reason if reason else "",
                "equivalent": bool(reason and reason.is_equivalent),
            }

    def count(some: Sequence[Mutant]) -> Row:
        rows, left = [verdicts[mutant.id] for mutant in some], [survivors[m.id] for m in some if m.id in survivors]
        same = sum(survivor["equivalent"] for survivor in left)
        killed = len(rows) - len(left)
        return {
            "mutants": len(rows),
            "killed": killed,
            "timeouts": sum(row["outcome"] == "timeout" for row in rows),
            "equivalent": same,
            "survived": len(left) - same,
            "share": round(killed / max(len(rows) - same, 1), 4),
            "seconds": round(sum(row["seconds"] for row in rows), 1),
        }

    subjects = sorted({subject_of(mutant.path) for mutant in mutants})
    return {
        **count(mutants),
        "subjects": {name: count([m for m in mutants if subject_of(m.path) == name]) for name in subjects},
        "survivors": list(survivors.values()),
    }
