"""The command: examine, tell, mend what is safe."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final

from cyclopts import Parameter
from rich.text import Text

from mkdaemon.cli import printing
from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import Console
from mkdaemon.cli.mkdaemon.doctor.check import Fault, Needs, Severity
from mkdaemon.cli.mkdaemon.doctor.machine import Machine
from mkdaemon.cli.mkdaemon.doctor.table import CHECKS, Examined, examine
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK, EXIT_WARNING
from mkdaemon.cli.terminal import on_one_line

_COLOURS: Final = {Severity.ERROR: "red", Severity.WARNING: "yellow", Severity.ADVICE: "cyan"}
_UNSEEN: Final = {Needs.CONFIG: "without --config", Needs.DAEMON: "without a running daemon"}


def doctor(
    *,
    config: Annotated[Path | None, Parameter(name=["--config", "-c"])] = None,
    connect: str | None = None,
    fix: bool = False,
    as_json: AsJson = False,
) -> int:
    """Find what stands between this machine and an aircraft, and say what to type.

    Each fault comes with what was found, why it matters, and the command that mends it; docs/troubles.md has them all.
    Nothing is sent to any device; a daemon that runs is asked. Exit code 0 without errors and warnings, 1 with an
    error, 3 with warnings alone.

    Examples:
        mkdaemon doctor --config /etc/mkdaemon/vehicle.toml
        mkdaemon doctor --fix
        mkdaemon doctor --json --connect tcp/192.168.1.7:7447

    Args:
        config: Also check what this configuration file names.
        connect: Ask the daemon at this Zenoh endpoint, too.
        fix: Type the commands that are safe: they end no program, and a restart or their opposite undoes them.
    """
    where = () if connect is None else (connect,)
    return run_doctor(Machine(), config, where, must_fix=fix, as_json=as_json)


def run_doctor(
    machine: Machine, config: Path | None, connect: tuple[str, ...] = (), *, must_fix: bool, as_json: bool
) -> int:
    """Examine a machine, mend it where that is wanted, print, and return the exit code."""
    seen = examine(machine, config, connect=connect)
    if must_fix:
        for finding in seen.findings:
            if finding.is_safe:
                _mend(machine, finding, as_json=as_json)
        seen = examine(replace(machine), config, connect=connect)
    if as_json:
        for finding in by_severity(seen.findings):
            print(printing.json_line(finding._asdict()))
    else:
        show(seen, Console())
    return {Severity.ERROR: EXIT_FAILURE, Severity.WARNING: EXIT_WARNING}.get(seen.worst() or Severity.ADVICE, EXIT_OK)


def by_severity(findings: Iterable[Fault]) -> list[Fault]:
    """What matters most first."""
    return sorted(findings, key=lambda finding: list(Severity).index(finding.severity))


def show(seen: Examined, console: Console) -> None:
    """Print findings and how much was looked at; what they quote from files is text, brackets and all."""
    for finding in by_severity(seen.findings):
        head = (f"{finding.severity:<7}", _COLOURS[finding.severity])
        console.print(Text.assemble(head, f" {finding.check}: {on_one_line(finding.what)}"), soft_wrap=True)
        console.print(Text(f"        {on_one_line(f'{finding.why} {finding.fix}')}"), soft_wrap=True)
        if finding.command:  # copied whole
            console.print(Text(f"        $ {on_one_line(finding.command)}", style="dim"), soft_wrap=True)
    counts = {level: sum(finding.severity is level for finding in seen.findings) for level in Severity}
    words = ", ".join(f"{count} {level}{'s' * (count > 1)}" for level, count in counts.items() if count)
    unseen = [f"{len(names)} see nothing {_UNSEEN[need]}" for need, names in seen.unseen.items()]
    console.print(Text("; ".join([f"{words or 'nothing found'} by {len(CHECKS)} checks", *unseen])), soft_wrap=True)


def _mend(machine: Machine, finding: Fault, *, as_json: bool) -> None:
    """Type a safe command, and say so."""
    command = finding.command.replace("sudo ", "") if os.geteuid() == 0 else finding.command
    is_done = machine.run(["sh", "-c", command]).code == 0
    words = f"{'typed' if is_done else 'FAILED'}: {on_one_line(command)}"
    printing.show({"check": finding.check, "typed": command, "is_done": is_done}, words, as_json=as_json)
