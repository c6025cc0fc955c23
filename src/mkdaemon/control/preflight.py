"""Before a client flies: does the FlightCtrl listen to stick frames, and can the pilot take over by a switch?

The parameter ExternalControl of the active set is the gate: up to 128 it is shut, 248 to 255 are a channel of the
transmitter, and a constant above 128 holds it open for good. Source: docs/safety.md; docs/firmware-notes, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from mkdaemon.telemetry.refusals import Token, refuse

OPEN_ABOVE: Final = 128
"""The gate is open while its value is above this."""


class GateKind(Enum):
    """What ExternalControl of the active set is."""

    UNKNOWN = auto()
    """It cannot be read here; the pilot's own check decides."""
    CHANNEL = auto()
    """A channel of the transmitter."""
    CONSTANT = auto()
    """A number."""


@dataclass(frozen=True, slots=True)
class Gate:
    """The gate as it was read.

    Attributes:
        kind: what it is.
        value: ExternalControl, 0..255; 0 where it is unknown.
        altitude_channel: receiver channel by which the same switch also turns height control on and off; None where
            it does not.
    """

    kind: GateKind
    value: int = 0
    altitude_channel: int | None = None


def check_gate(gate: Gate, *, allow_constant: bool) -> None:
    """Refuse a gate that is shut for good, one the pilot cannot shut, and one that switches height control too.

    With height control on the FlightCtrl takes the throttle of stick frames for something else.
    Source: docs/firmware-notes, "External control".

    Args:
        gate: as it was read.
        allow_constant: the operator accepts a constant.

    Raises:
        CommandRejectedError: `gate_shut`, `gate_constant`, `gate_switches_altitude`.
    """
    if gate.altitude_channel is not None:
        raise refuse(Token.GATE_SWITCHES_ALTITUDE, channel=gate.altitude_channel)
    if gate.kind is not GateKind.CONSTANT:
        return
    if gate.value <= OPEN_ABOVE:
        raise refuse(Token.GATE_SHUT, value=gate.value)
    if not allow_constant:
        raise refuse(Token.GATE_CONSTANT, value=gate.value)
