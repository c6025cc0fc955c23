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
    """`j` to the FlightCtrl: it serves the receiver's port and is deaf until its power is cut.

    The aircraft cannot be flown until its battery was unplugged."""
    allow_factory_reset: Annotated[bool, RELOADABLE] = False
    """`q` 10..29: overwrites a parameter set with defaults.

    The settings of a set are lost: back them up first."""
    allow_compass_calibration: Annotated[bool, RELOADABLE] = False
    """`w` or `k` to the MK3Mag: its calibration state follows what we claim to be.

    A calibration that was begun and not ended leaves a wrong compass."""
    allow_fork_arming: Annotated[bool, RELOADABLE] = False
    """`x`, `e`, `r`, `o` of the forked FlightCtrl: arm, disarm (in flight too), recalibrate, beep.

    Nothing on the line tells the fork from stock firmware: turning this on says that this aircraft has the fork.
    On stock firmware the letters mean other things, which are then sent."""
