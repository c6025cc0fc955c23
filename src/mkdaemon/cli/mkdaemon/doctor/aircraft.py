"""Checks of the aircraft and its line, by what a running daemon knows of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mkdaemon.cli.mkdaemon.doctor.check import CheckPart, Needs, Patient, Severity, Values
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.record import RecorderState

AIRCRAFT: Final = CheckPart("The aircraft")

GATE: Final = ("gate_constant", "gate_shut", "gate_switches_altitude")
HEIGHT: Final = "height_control"
LINK: Final = "link_down"


def _standing(patient: Patient, tokens: tuple[str, ...]) -> Iterator[Values]:
    for token in tokens:
        if token in patient.report.standing:
            name, reason, fix = patient.report.standing[token]
            yield {"name": name, "reason": reason, "fix": fix}


@AIRCRAFT("line-rate", Severity.ERROR, Needs.DAEMON)
def _garbage(patient: Patient) -> Iterator[Values]:
    """bytes arrive on {port} at {baud} baud, but no valid frame

    {reason}

    Set link.baud, and the radios at both ends, to 57600.

    $ mkctl health
    """
    line = patient.report.line
    if line is not None and line.condition is LinkCondition.GARBAGE:
        yield {"port": line.port, "baud": line.baud, "reason": line.reason}


@AIRCRAFT("line-baud", Severity.WARNING, Needs.DAEMON)
def _other_baud(patient: Patient) -> Iterator[Values]:
    """the line runs at {used} baud, but link.baud is {configured}

    The daemon found the rate by trial, and repeats the trial whenever it opens the port.

    Write it into the configuration.

    $ sed -i {edit} {file}
    """
    line = patient.report.line
    if line is not None and patient.file is not None and line.baud != patient.cfg.link.baud:
        edit = f"s/^baud *= *{patient.cfg.link.baud}/baud = {line.baud}/"
        yield {"used": line.baud, "configured": patient.cfg.link.baud, "edit": edit, "file": patient.file}


@AIRCRAFT("line", Severity.ERROR, Needs.DAEMON)
def _down(patient: Patient) -> Iterator[Values]:
    """the link on {port} is {condition}

    {reason}

    Check cable, power and radio.

    $ mkctl health
    """
    line = patient.report.line
    fine = (LinkCondition.UP, LinkCondition.GARBAGE)
    if line is not None and line.condition not in fine:
        yield {"condition": line.condition, "reason": line.reason, "port": line.port}


@AIRCRAFT("gate", Severity.ERROR, Needs.DAEMON)
def _gate(patient: Patient) -> Iterator[Values]:
    """{name}: {reason}

    A switch of the transmitter must be able to end external control.

    {fix}

    $ mkctl settings write external_control=poti1
    """
    return _standing(patient, GATE)


@AIRCRAFT("height-control", Severity.ERROR, Needs.DAEMON)
def _height(patient: Patient) -> Iterator[Values]:
    """{name}: {reason}

    The FlightCtrl would use the daemon's throttle as a climb rate.

    {fix}

    $ mkctl settings show global_config
    """
    return _standing(patient, (HEIGHT,))


@AIRCRAFT("preflight", Severity.WARNING, Needs.DAEMON)
def _others(patient: Patient) -> Iterator[Values]:
    """{name}: {reason}

    The daemon refuses flights until it is cured.

    {fix}

    $ mkctl preflight
    """
    named = {*GATE, HEIGHT, LINK}  # each has a separate row
    return _standing(patient, tuple(token for token in patient.report.standing if token not in named))


@AIRCRAFT("recorder", Severity.WARNING, Needs.DAEMON)
def _not_recording(patient: Patient) -> Iterator[Values]:
    """the daemon does not record ({state}): {reason}

    After the flight there is no record of what happened.

    Make room, or set record.folder.

    $ mkctl status
    """
    recorder = patient.report.recorder
    if recorder is not None and recorder.state in (RecorderState.FULL, RecorderState.FAULT):
        yield {"state": recorder.state, "reason": recorder.reason}
