"""Which dangerous requests clients may make at all."""

from __future__ import annotations

from typing import Annotated

from mkdaemon.config.base import RELOADABLE, Section


class CommandsConfig(Section):
    """Requests that are off by default; turn one on only if you know its effect on this aircraft.

    Every other dangerous request is allowed, but only through the gate: motors known stopped, the right board proven,
    and the field `confirm` in the request. See docs/protocol.md, "Danger".
    """

    allow_reset: Annotated[bool, RELOADABLE] = False
    """`R`: reboots the FlightCtrl, or sends the NaviCtrl to its boot loader (never ignored, even in flight).

    In flight the aircraft falls."""
    allow_receiver_bridge: Annotated[bool, RELOADABLE] = False
    """`j` to the FlightCtrl: it serves the receiver's port and receives nothing until power-off.

    The aircraft cannot fly until its battery is unplugged."""
    allow_factory_reset: Annotated[bool, RELOADABLE] = False
    """`q` 10..29: overwrites a parameter set with defaults.

    The settings of a set are lost: back them up first."""
    allow_compass_calibration: Annotated[bool, RELOADABLE] = False
    """`w` or `k` to the MK3Mag: it takes the calibration state from the sender.

    An unfinished calibration leaves a wrong compass."""
    allow_fork_arming: Annotated[bool, RELOADABLE] = False
    """`x`, `e`, `r`, `o` of the forked FlightCtrl: arm, disarm (in flight too), recalibrate, beep.

    The daemon cannot distinguish the fork from stock firmware, which gives these letters other meanings: set true only
    if this aircraft has the fork."""
