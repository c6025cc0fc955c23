"""What a check is: one row, with the function that looks; and what it finds."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import StrEnum
from functools import cached_property
from inspect import getdoc
from pathlib import Path
from typing import NamedTuple

from mkdaemon.cli.mkdaemon.doctor.daemonreport import DaemonReport
from mkdaemon.cli.mkdaemon.doctor.machine import Machine
from mkdaemon.client.connection import DEFAULT_VEHICLE
from mkdaemon.config.root import Config

Values = Mapping[str, object]
"""What the words of a row have in braces."""


class Typed(str):
    """A part of a command that stands in it as it is; every other value is quoted."""

    __slots__ = ()


class Severity(StrEnum):
    """How much a fault matters."""

    ERROR = "error"
    """No flight, or none that is safe, while it stands."""
    WARNING = "warning"
    """It flies, and something may fail or comes late."""
    ADVICE = "advice"
    """It could be better."""


class Needs(StrEnum):
    """Without what a check sees nothing."""

    MACHINE = "machine"
    """It sees what it needs on every machine."""
    CONFIG = "config"
    """A configuration file."""
    DAEMON = "daemon"
    """A running daemon."""


class Patient:
    """What is examined.

    Attributes:
        machine: files, commands, processes.
        file: the configuration file; None without one.
        cfg: what stands in it; the defaults without one, or where it is wrong.
        mistake: why it cannot be read; empty where it can.
    """

    def __init__(
        self, machine: Machine, file: Path | None, cfg: Config, mistake: str, listen: Callable[[Patient], DaemonReport]
    ) -> None:
        self.machine, self.file, self.cfg, self.mistake = machine, file, cfg, mistake
        self._listen = listen

    @cached_property
    def report(self) -> DaemonReport:
        """What a running daemon says of itself and of the aircraft."""
        return self._listen(self)


Look = Callable[[Patient], Iterable[Values]]


class Fault(NamedTuple):
    """One fault.

    Attributes:
        check: name of the row.
        severity: how much it matters.
        what: what was found.
        why: why it matters.
        fix: what to do.
        command: what to type; empty where nothing can be typed.
        is_safe: `--fix` may type it.
    """

    check: str
    severity: Severity
    what: str
    why: str
    fix: str
    command: str
    is_safe: bool


class Check(NamedTuple):
    """One check: what it finds, in words, and the function that looks.

    Attributes:
        name: of the check.
        severity: of what it finds.
        needs: without what it sees nothing.
        is_safe: `--fix` types the command: it ends no program and is undone by the next start, or by its opposite.
        what: what was found; words in braces come from `look`.
        why: why it matters.
        fix: what to do; empty where the command says it.
        command: what to type; empty where nothing can be typed.
        look: yields the words for each fault; nothing on a healthy machine.
    """

    name: str
    severity: Severity
    needs: Needs
    is_safe: bool
    what: str
    why: str
    fix: str
    command: str
    look: Look

    def examine(self, patient: Patient) -> Iterator[Fault]:
        """Every fault of this kind."""
        for values in self.look(patient):
            quoted = {
                name: value if isinstance(value, Typed) else shlex.quote(str(value)) for name, value in values.items()
            }
            what, why, fix = (text.format_map(values) for text in (self.what, self.why, self.fix))
            command = _addressed(self.command.format_map(quoted), patient.cfg.vehicle.name)
            yield Fault(self.name, self.severity, what, why, fix, command, self.is_safe)

    def described(self) -> Check:
        """The row for readers of a page: words in braces in capital letters."""
        what, why, fix, command = (
            text.format_map(_Capitals()) for text in (self.what, self.why, self.fix, self.command)
        )
        return self._replace(what=what, why=why, fix=fix, command=command)


def _addressed(command: str, vehicle: str) -> str:
    """A command of a client, to this vehicle."""
    return f"{command} --vehicle {vehicle}" if command.startswith("mkctl ") and vehicle != DEFAULT_VEHICLE else command


class _Capitals(dict[str, str]):
    """Names for values: `{port}` becomes PORT."""

    def __missing__(self, name: str) -> str:
        return name.upper()


class CheckPart:
    """Checks of one thing, in the order in which it goes wrong.

    Attributes:
        title: what they look at.
        checks: every one.
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self.checks: list[Check] = []

    def __call__(
        self, name: str, severity: Severity, needs: Needs = Needs.MACHINE, *, is_safe: bool = False
    ) -> Callable[[Look], Look]:
        """Make a function a check.

        Its docstring is what the doctor prints, with words in braces for the values that the function yields: what was
        found, why it matters, what to do and, behind `$`, what to type.

        Args:
            name: of the check.
            severity: of what it finds.
            needs: without what it sees nothing.
            is_safe: `--fix` types the command.
        """

        def add(look: Look) -> Look:
            what, why, *rest = (" ".join(part.split()) for part in (getdoc(look) or name).split("\n\n"))
            command = rest.pop().removeprefix("$ ") if rest and rest[-1].startswith("$ ") else ""
            self.checks.append(Check(name, severity, needs, is_safe, what, why, " ".join(rest), command, look))
            return look

        return add
