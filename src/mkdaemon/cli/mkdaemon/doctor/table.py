"""The table of all checks, and the walk through it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.cli.mkdaemon.doctor.aircraft import AIRCRAFT
from mkdaemon.cli.mkdaemon.doctor.busline import BUS, listener_at, owner_of
from mkdaemon.cli.mkdaemon.doctor.camerafaults import CAMERAS
from mkdaemon.cli.mkdaemon.doctor.check import CheckPart, Fault, Needs, Patient, Severity, Values
from mkdaemon.cli.mkdaemon.doctor.computer import COMPUTER
from mkdaemon.cli.mkdaemon.doctor.daemonreport import NO_DAEMON, DaemonReport
from mkdaemon.cli.mkdaemon.doctor.machine import Machine
from mkdaemon.cli.mkdaemon.doctor.serialline import SERIAL_LINE
from mkdaemon.cli.mkdaemon.runoptions import NONE_GIVEN, load_configuration
from mkdaemon.config.root import Config
from mkdaemon.daemon.runnable import mistakes
from mkdaemon.errors import ConfigError

CONFIGURATION: Final = CheckPart("The configuration")


@CONFIGURATION("configuration", Severity.ERROR, Needs.CONFIG)
def _mistakes(patient: Patient) -> Iterator[Values]:
    """{mistake}

    `mkdaemon run` refuses it.

    Correct {file}.

    $ mkdaemon config check {file}
    """
    # What `mkdaemon run` would refuse, in its words
    if patient.mistake:
        yield {"mistake": patient.mistake, "file": patient.file or "the environment"}
    if patient.mistake or patient.file is None:
        return
    cfg = patient.cfg
    if not cfg.link.port:  # the next row reports it
        cfg = cfg.model_copy(update={"link": cfg.link.model_copy(update={"port": "/dev/null"})})
    for mistake in mistakes(cfg):
        yield {"mistake": mistake, "file": patient.file}


@CONFIGURATION("port-unset", Severity.ADVICE, Needs.CONFIG)
def _no_port(patient: Patient) -> Iterator[Values]:
    """{file} names no port

    The daemon starts only with --port.

    Set link.port.

    $ mkdaemon config explain link.port
    """
    if patient.file is not None and not patient.mistake and not patient.cfg.link.port:
        yield {"file": patient.file}


PARTS: Final = (CONFIGURATION, SERIAL_LINE, COMPUTER, BUS, CAMERAS, AIRCRAFT)
"""What is looked at, in the order in which things go wrong."""
CHECKS: Final = tuple(check for part in PARTS for check in part.checks)
"""Every check; a further one is one function."""


class Examined(NamedTuple):
    """What the doctor saw.

    Attributes:
        findings: every fault.
        unseen: checks that could see nothing, by what they need.
    """

    findings: tuple[Fault, ...]
    unseen: dict[Needs, tuple[str, ...]]

    def worst(self) -> Severity | None:
        """Of the findings; None without any."""
        return min((finding.severity for finding in self.findings), key=list(Severity).index, default=None)


def examine(machine: Machine, file: Path | None, *, connect: Sequence[str] = ()) -> Examined:
    """Make every check.

    Args:
        machine: where to look.
        file: the configuration; None for none.
        connect: endpoints at which to ask for a daemon before those of the configuration.
    """
    cfg, mistake = Config(), ""
    try:
        cfg = load_configuration(file, NONE_GIVEN).cfg
    except ConfigError as error:
        mistake = str(error)
    patient = Patient(machine, file, cfg, mistake, lambda patient: _listen(patient, connect))
    findings = tuple(finding for check in CHECKS for finding in check.examine(patient))
    missing = {
        Needs.CONFIG: file is None or bool(mistake),
        Needs.DAEMON: not patient.report.daemons,
    }
    unseen = {
        need: tuple(check.name for check in CHECKS if check.needs is need)
        for need, is_missing in missing.items()
        if is_missing
    }
    return Examined(findings, unseen)


def _listen(patient: Patient, connect: Sequence[str]) -> DaemonReport:
    """Query the daemon that listens here or that a router leads to; without a listener, make no query."""
    bus = patient.cfg.bus
    here = []
    for endpoint in bus.listen:
        listener = listener_at(patient, endpoint)
        owner = None if listener is None else owner_of(patient, listener)
        if listener is not None and (owner is None or owner.is_ours):
            here.append(endpoint)
    endpoints = (*connect, *here, *bus.connect)
    return patient.machine.ask(patient.cfg, endpoints) if endpoints else NO_DAEMON
