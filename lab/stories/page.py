"""docs/lab/stories.md: the table of stories, rewritten case by case from what was measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from lab.stories.deaths import Death

HEAD: Final = f"""# Stories and their evidence

What happens when something dies while a client flies, measured against the simulated boards. Every row is written by
`python -m lab stories --page docs/lab/stories.md` (`--case NAME` for one group); nothing here is typed by hand. Times
count from the last setpoint the daemon could use, as far as nothing else is said; seeds make every run in virtual time
repeatable. `deaths`, `unreleased`, `cable`, `swap`, `reboot`, `freeze`, `restart` and `faults` run in virtual time, the
others with real processes, Zenoh sessions and pseudo terminals, so their times include whatever else the machine did.

Every way in which a client dies: {", ".join(Death)}
(`lab/stories/deaths.py` says what each is). A valid frame has the valid bit of external control set. The soak streams O
every 100 ms, D every 200 and C every 50, with ten link tests and 40 stick frames a second.

| case | story | boards | runs | measured | limit | holds |
|---|---|---|---|---|---|---|
"""
ORDER: Final = (
    *("deaths", "unreleased", "clients", "cable", "swap", "reboot", "freeze", "restart"),
    *("plug", "kill", "race", "faults", "soak"),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table.

    Attributes:
        case: which group it belongs to.
        story: what was tried.
        boards: on which aircraft.
        runs: how often.
        figure: what was measured.
        limit: what it may be at most, in the same order.
        holds: whether it is so.
        detail: everything measured, for the JSON output.
    """

    case: str
    story: str
    boards: str
    runs: int
    figure: str
    limit: str
    holds: bool
    detail: dict[str, Any] = field(default_factory=dict)

    def line(self) -> str:
        """The row as Markdown."""
        cells = (self.case, self.story, self.boards, self.runs, self.figure, self.limit, "yes" if self.holds else "NO")
        return "| " + " | ".join(str(cell) for cell in cells) + " |"


def write_page(path: Path, rows: list[Row]) -> None:
    """Replace the rows of the cases that were run, and keep the others."""
    told = {row.case for row in rows}
    kept = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    lines = [line for line in kept if _case(line) in ORDER and _case(line) not in told] + [row.line() for row in rows]
    lines.sort(key=lambda line: ORDER.index(_case(line)))  # stable: the order within a case stays
    path.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")


def _case(line: str) -> str:
    return line.split("|")[1].strip() if line.startswith("| ") else ""
