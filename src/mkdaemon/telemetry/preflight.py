"""Checks before a flight: condition, result, remedy."""

from enum import StrEnum
from typing import Final

from mkdaemon.telemetry.base import Stamped, Telemetry

LEAST_DISK: Final = 200e6
"""Free space with which a flight may begin [bytes]: an hour of the recorder's small streams."""


class Blocks(StrEnum):
    """What a failed check prevents."""

    LEASE = "lease"
    """The lease is refused."""
    AUTONOMY = "autonomy"
    """No flight against a target begins; sticks and attitudes fly."""
    NOTHING = "nothing"
    """It is advice."""


class CheckState(StrEnum):
    """Result of a check."""

    PASSED = "passed"
    """All is well."""
    STANDS = "stands"
    """Something is in the way; `blocks` says of what."""
    UNKNOWN = "unknown"
    """Nothing here can tell; the pilot's own check decides."""


class Finding(Telemetry):
    """One check."""

    name: str
    """Of the check."""
    state: CheckState
    """What it found."""
    blocks: Blocks
    """What is prevented while it stands."""
    token: str | None
    """Of the refusal; null where it does not stand."""
    reason: str
    """What was found, in words."""
    fix: str
    """What to do; empty where nothing has to be done."""


class PreflightReport(Telemetry):
    """Every check before a flight: the answer to `do/preflight`."""

    is_ready: bool
    """Nothing prevents a flight against a target."""
    findings: tuple[Finding, ...]
    """Every check."""


class ControlPreflight(Stamped, PreflightReport):
    """The same as `control/preflight`, whenever the checks were made for a client."""
