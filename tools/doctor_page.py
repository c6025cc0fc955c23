"""The checks of `mkdaemon doctor` as rows of docs/troubles.md."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mkdaemon.cli.mkdaemon.doctor.check import Check, Needs
from mkdaemon.cli.mkdaemon.doctor.table import CHECKS

_NEEDS: Final = {Needs.MACHINE: "", Needs.CONFIG: ", with a file", Needs.DAEMON: ", with a daemon"}


def doctor_rows() -> Iterator[tuple[str, str]]:
    """Return for each check, in the order of the table, what is printed, and why it matters and what to do."""
    for check in CHECKS:
        shown = check.described()
        command = f"`{shown.command}`{' (safe)' if check.is_safe else ''}" if shown.command else ""
        remedy = " ".join(part for part in (shown.why, shown.fix, command) if part)
        yield f"**{shown.name}** ({_grade(check)}): {shown.what}", remedy


def _grade(check: Check) -> str:
    return f"{check.severity}{_NEEDS[check.needs]}"
