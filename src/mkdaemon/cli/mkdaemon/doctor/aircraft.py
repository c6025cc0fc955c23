"""Checks of the aircraft and its line, by what a running daemon knows of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mkdaemon.cli.mkdaemon.doctor.check import Check, Needs, Patient, Severity, Values
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.record import RecorderState

GATE: Final = ("gate_constant", "gate_shut", "gate_switches_altitude")
HEIGHT: Final = "height_control"
LINK: Final = "link_down"


def _garbage(patient: Patient) -> Iterator[Values]:
    line = patient.report.line
    if line is not None and line.condition is LinkCondition.GARBAGE:
        yield {"port": line.port, "baud": line.baud, "reason": line.reason}


def _down(patient: Patient) -> Iterator[Values]:
    line = patient.report.line
    fine = (LinkCondition.UP, LinkCondition.GARBAGE)
    if line is not None and line.condition not in fine:
        yield {"condition": line.condition, "reason": line.reason, "port": line.port}


def _other_baud(patient: Patient) -> Iterator[Values]:
    line = patient.report.line
    if line is not None and patient.file is not None and line.baud != patient.cfg.link.baud:
        edit = f"s/^baud *= *{patient.cfg.link.baud}/baud = {line.baud}/"
        yield {"used": line.baud, "configured": patient.cfg.link.baud, "edit": edit, "file": patient.file}


def _standing(patient: Patient, tokens: tuple[str, ...]) -> Iterator[Values]:
    for token in tokens:
        if token in patient.report.standing:
            name, reason, fix = patient.report.standing[token]
            yield {"name": name, "reason": reason, "fix": fix}


def _gate(patient: Patient) -> Iterator[Values]:
    return _standing(patient, GATE)


def _height(patient: Patient) -> Iterator[Values]:
    return _standing(patient, (HEIGHT,))


def _others(patient: Patient) -> Iterator[Values]:
    named = {*GATE, HEIGHT, LINK}  # each has a row of its own
    return _standing(patient, tuple(token for token in patient.report.standing if token not in named))


def _not_recording(patient: Patient) -> Iterator[Values]:
    recorder = patient.report.recorder
    if recorder is not None and recorder.state in (RecorderState.FULL, RecorderState.FAULT):
        yield {"state": recorder.state, "reason": recorder.reason}


AIRCRAFT: Final = (
    Check(
        "line-rate",
        Severity.ERROR,
        what="bytes arrive on {port} at {baud} baud, and none of them is a frame",
        why="{reason}",
        fix="Set link.baud, and the radios at both ends, to 57600.",
        command="mkctl health",
        look=_garbage,
        needs=Needs.DAEMON,
    ),
    Check(
        "line-baud",
        Severity.WARNING,
        what="the line runs at {used} baud, and link.baud is {configured}",
        why="The daemon found the rate by trying, which it repeats each time it opens the port.",
        fix="Write it into the configuration.",
        command="sed -i {edit} {file}",
        look=_other_baud,
        needs=Needs.DAEMON,
    ),
    Check(
        "line",
        Severity.ERROR,
        what="the line {port} is {condition}",
        why="{reason}",
        fix="Check cable, power and radio.",
        command="mkctl health",
        look=_down,
        needs=Needs.DAEMON,
    ),
    Check(
        "gate",
        Severity.ERROR,
        what="{name}: {reason}",
        why="A switch of the transmitter must be able to end external control.",
        fix="{fix}",
        command="mkctl settings write external_control=poti1",
        look=_gate,
        needs=Needs.DAEMON,
    ),
    Check(
        "height-control",
        Severity.ERROR,
        what="{name}: {reason}",
        why="The FlightCtrl would take our throttle for a climb rate.",
        fix="{fix}",
        command="mkctl settings show global_config",
        look=_height,
        needs=Needs.DAEMON,
    ),
    Check(
        "preflight",
        Severity.WARNING,
        what="{name}: {reason}",
        why="No flight begins while it stands.",
        fix="{fix}",
        command="mkctl preflight",
        look=_others,
        needs=Needs.DAEMON,
    ),
    Check(
        "recorder",
        Severity.WARNING,
        what="the daemon does not record ({state}): {reason}",
        why="After the flight there is no record of what happened.",
        fix="Make room, or set record.folder.",
        command="mkctl status",
        look=_not_recording,
        needs=Needs.DAEMON,
    ),
)
"""Checks of the aircraft."""
