"""Which dangerous requests clients may make at all."""

from __future__ import annotations

from mkdaemon.config.base import Section


class CommandsConfig(Section):
    """Requests that are off until someone who knows the aircraft turns them on.

    Every other dangerous request is allowed, but only through the gate: motors known stopped, the right board proven,
    and the field `confirm` in the request. See docs/protocol.md, "Danger".
    """

    allow_reset: bool = False
    """`R`: reboots the FlightCtrl, or sends the NaviCtrl to its boot loader (never ignored, even in flight)."""
    allow_receiver_bridge: bool = False
    """`j` to the FlightCtrl: it serves the receiver's port and is deaf until its power is cut."""
    allow_factory_reset: bool = False
    """`q` 10..29: overwrites a parameter set with defaults."""
    allow_compass_calibration: bool = False
    """`w` or `k` to the MK3Mag: its calibration state follows what we claim to be."""
    allow_fork_arming: bool = False
    """`x`, `e`, `r`, `o` of the forked FlightCtrl: arm, disarm (in flight too), recalibrate, beep.

    Nothing on the line tells the fork from stock firmware: turning this on says that this aircraft has the fork.
    """
