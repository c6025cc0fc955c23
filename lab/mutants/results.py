"""What became of mutants: kept between runs, summed up, and the survivors with a reason each."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from lab.mutants.operators import Mutant
from lab.mutants.sessions import Verdict
from mkdaemon.errors import ConfigError

REASONS: Final = Path("lab/mutants/survivors.toml")
"""Mutants that no test kills, and why that is right; from the root of the tree."""
KILLED: Final = ("killed", "timeout")


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
    is_equivalent: bool

    def fits(self, mutant: Mutant) -> bool:
        """Whether it is about this mutant."""
        return (self.path, self.scope, self.was, self.becomes) == (
            mutant.path,
            mutant.scope,
            mutant.was,
            mutant.becomes,
        )


def read_reasons(file: Path) -> list[Reason]:
    """Read the reasons.

    Raises:
        ConfigError: it cannot be read, or a word is missing or unknown.
    """
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        return [Reason(**{"is_equivalent": False, **entry}) for entry in content.get("survivor", ())]
    except (OSError, TypeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{file}: {error}") from None


class Store:
    """Verdicts of earlier runs that still hold, one JSON object a line.

    A verdict holds while the file of its mutant is the same, and the test that killed it is; a survivor's while all
    files are. Where only tests are new, a survivor has to outlive those alone.

    Args:
        file: where they are kept.
        fingerprint_of: of a file's content, its path from the root.

    Attributes:
        verdicts: those that hold, by the mutants' ids.
        first: verdicts that were found first, while the file of the mutant was as it is now, by id; tests that were
            written later change none.
    """

    def __init__(self, file: Path, fingerprint_of: Mapping[str, str]) -> None:
        self._file = file
        self._fingerprint_of = fingerprint_of
        self._all = fingerprint("".join(sorted(fingerprint_of.values())))
        self._outlived: dict[str, set[str]] = {}
        self.verdicts: dict[str, Verdict] = {}
        self.first: dict[str, Verdict] = {}
        for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
            self._read(json.loads(line))

    def _read(self, kept: dict[str, Any]) -> None:
        verdict = Verdict(**kept["verdict"])
        self.verdicts.pop(verdict.mutant, None)
        if kept["source"] != self._source(verdict):
            return
        self.first.setdefault(verdict.mutant, verdict)
        same = {file for file, print_ in kept["files"].items() if self._fingerprint_of.get(file) == print_}
        if kept["all"] == self._all or (verdict.by.partition("::")[0] in same):
            self.verdicts[verdict.mutant] = verdict
        elif verdict.outcome == "survived":
            self._outlived[verdict.mutant] = same

    def _source(self, verdict: Verdict) -> str:
        return self._fingerprint_of.get(verdict.mutant.partition(":")[0], "")

    def outlived(self, mutant: str) -> set[str]:
        """Files of tests that are as they were when the mutant outlived all it chose of them."""
        return self._outlived.get(mutant, set())

    def killers(self) -> Counter[tuple[str, str]]:
        """How many mutants of a file a test killed."""
        return Counter((v.mutant.partition(":")[0], v.by) for v in self.verdicts.values() if v.outcome == "killed")

    def forget(self) -> None:
        """Let no verdict hold; those that were first stay so."""
        self.verdicts.clear()
        self._outlived.clear()

    def add(self, verdict: Verdict, files: Iterable[str]) -> None:
        """Keep one more, and the files of the tests that were run."""
        self.verdicts[verdict.mutant] = verdict
        self.first.setdefault(verdict.mutant, verdict)
        judges = [verdict.by.partition("::")[0]] if verdict.outcome == "killed" else files
        prints = {file: self._fingerprint_of[file] for file in judges if file in self._fingerprint_of}
        kept = {"verdict": asdict(verdict), "source": self._source(verdict), "files": prints, "all": self._all}
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(kept) + "\n")


def fingerprint(text: str) -> str:
    """Return a short name of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def sum_up(
    mutants: Sequence[Mutant],
    verdicts: Mapping[str, Verdict],
    reasons: Sequence[Reason],
    subject_of: Callable[[str], str] = str,
    first: Mapping[str, Verdict] | None = None,
) -> dict[str, Any]:
    """Count.

    Args:
        mutants: those that were tried.
        verdicts: of all of them, by id.
        reasons: of those that may survive.
        subject_of: what a file belongs to.
        first: verdicts before tests were written for survivors; None where they are the same.

    Returns:
        Counts in all, by subject, by file and by operator; each survivor with its reason, empty where nobody wrote
        one. The shares killed, at last and at first, leave out the equivalent ones, and only those.
    """
    at_first = verdicts if first is None else first
    survivors: list[dict[str, Any]] = []
    for mutant in mutants:
        if verdicts[mutant.id].outcome not in KILLED:
            reason = next((reason for reason in reasons if reason.fits(mutant)), None)
            survivors.append(
                {
                    "id": mutant.id,
                    "scope": mutant.scope,
                    "was": mutant.was,
                    "becomes": mutant.becomes,
                    "reason": reason.reason if reason else "",
                    "equivalent": bool(reason and reason.is_equivalent),
                }
            )
    equivalent = {survivor["id"] for survivor in survivors if survivor["equivalent"]}

    def count(key: Callable[[Mutant], str]) -> dict[str, dict[str, Any]]:
        return {
            name: _count([mutant for mutant in mutants if key(mutant) == name], verdicts, at_first, equivalent)
            for name in sorted({key(mutant) for mutant in mutants})
        }

    return {
        **_count(mutants, verdicts, at_first, equivalent),
        "subjects": count(lambda mutant: subject_of(mutant.path)),
        "files": count(lambda mutant: mutant.path),
        "operators": count(lambda mutant: mutant.operator),
        "survivors": survivors,
    }


def _count(
    mutants: Iterable[Mutant], verdicts: Mapping[str, Verdict], first: Mapping[str, Verdict], equivalent: set[str]
) -> dict[str, Any]:
    outcomes = [(mutant.id, verdicts[mutant.id].outcome) for mutant in mutants]
    killed_first = sum(first[name].outcome in KILLED for name, _ in outcomes)
    killed = sum(outcome in KILLED for _, outcome in outcomes)
    same = sum(name in equivalent for name, _ in outcomes)
    return {
        "mutants": len(outcomes),
        "killed": killed,
        "timeouts": sum(outcome == "timeout" for _, outcome in outcomes),
        "equivalent": same,
        "survived": len(outcomes) - killed - same,
        "share": round(killed / max(len(outcomes) - same, 1), 4),
        "killed_first": killed_first,
        "share_first": round(killed_first / max(len(outcomes) - same, 1), 4),
        "seconds": round(sum(verdicts[name].seconds for name, _ in outcomes), 1),
    }
