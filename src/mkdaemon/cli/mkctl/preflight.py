"""`mkctl preflight`: every check before a flight, with a remedy for each that fails."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import Parameter
from rich.table import Table

from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.mkctl.gains import show_gains
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding, PreflightReport

_PREVENTS: Final = {Blocks.LEASE: "NO LEASE", Blocks.AUTONOMY: "NO AUTONOMY", Blocks.NOTHING: "advice"}

_FIRST: Final = (CheckState.STANDS, CheckState.UNKNOWN, CheckState.PASSED)


async def preflight(
    *,
    gains: Annotated[bool, Parameter(help="Show model, gains and margins of the loop instead.")] = False,
    connection: Connection = HERE,
) -> int:
    """Make every check before a flight, and show what to do.

    The daemon makes the same checks when a client takes the lease and before a flight against a target, and refuses
    while one fails. A check that the daemon cannot make is "unknown": look yourself. Exit code 0 when nothing
    prevents a flight against a target, else 1.

    Example: mkctl preflight

    Raises:
        MkError: no daemon.
    """
    if gains:
        await show_gains(connection)
        return EXIT_OK
    async with connection.open() as uav:
        report = await uav.preflight()
    if not connection.json:
        table = Table("check", "found", "what it is, and what to do", show_lines=False)
        for finding in sorted(report.findings, key=_urgency):
            word = _PREVENTS[finding.blocks] if finding.state is CheckState.STANDS else finding.state.value
            table.add_row(finding.name, word, " ".join(filter(None, (finding.reason, finding.fix))))
        Console().print(table)
    connection.show(report.model_dump(mode="json"), _conclusion(report))
    return 0 if report.is_ready else EXIT_FAILURE


def _urgency(finding: Finding) -> tuple[int, int]:
    """Failed checks come first, then those that the user must look at; otherwise in the daemon's order."""
    return _FIRST.index(finding.state), list(Blocks).index(finding.blocks)


def _conclusion(report: PreflightReport) -> str:
    """Whether a flight may begin, and how many checks could not be made."""
    if not report.is_ready:
        return "not ready: see above"
    unseen = sum(finding.state is CheckState.UNKNOWN for finding in report.findings)
    look = f"; unknown from here, look yourself: {unseen}" if unseen else ""
    return f"nothing prevents an autonomous flight{look}"
