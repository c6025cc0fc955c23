"""A recorded session flown again, against a simulator and nothing else."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Final

from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError, DeviceState
from mkdaemon.cli.mkctl.teleop.padrecording import PadLine
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.client import Vehicle
from mkdaemon.client.teleop.inputs import PadFacts
from mkdaemon.telemetry.link import LinkState
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.sim import SimTruth

TRUTH_AGE: Final = 1.0
"""Oldest word of the simulator that counts [s]; it speaks fifty times a second."""
CHECKING: Final = 0.5
"""Between two checks that it is still a simulator [s]."""


class ReplayedDevice:
    """A device of a recording.

    Attributes:
        name: as it was.
        facts: as they were.
        state: what it answered last, at the times of the replay.
    """

    def __init__(self, name: str, facts: PadFacts) -> None:
        self.name, self.facts = name, facts
        self.state: DeviceState | None = None
        self.is_over = False

    def ask(self, now: float) -> DeviceState | None:
        """Return what it answered then.

        Raises:
            DeviceLostError: the recording is over.
        """
        if self.is_over:
            raise DeviceLostError("the recording is over")
        return self.state

    def alarm(self) -> None:
        """Nothing shakes."""

    def let_go(self) -> None:
        """Nothing: what was pressed then is pressed now."""

    def close(self) -> None:
        """Nothing is open."""


async def feed(session: TeleopSession, lines: Sequence[PadLine]) -> None:
    """Give a session what its devices said, at the same distances in time; returns when the recording is over.

    Args:
        session: without devices.
        lines: the recording.
    """
    devices: dict[str, ReplayedDevice] = {}
    began = session.now
    for line in lines:
        await asyncio.sleep(max(began + line.t - session.now, 0.0))
        match line.event:
            case "attach":
                assert line.facts is not None
                assert line.mapping is not None
                devices[line.device] = ReplayedDevice(line.device, line.facts.read())
                session.attach(devices[line.device], line.mapping)
            case "state" if line.device in devices:
                device = devices[line.device]
                before = {} if device.state is None else device.state.values
                device.state = DeviceState({**before, **line.values}, began + line.at)
            case "report":
                session.reported(line.device, line.control, line.raw, began + line.t)
            case "lost":
                session.lost(line.device, line.reason)
                devices.pop(line.device, None)
            case _:
                continue
    for device in devices.values():
        device.is_over = True


async def require_simulator(uav: Vehicle) -> None:
    """Make sure that the daemon's port is the simulator's: the pseudo terminal that the simulator itself holds.

    The simulator says on the bus which pseudo terminal it serves, and on which boot of which machine; the daemon says
    which port it has open. No aircraft can be at the other end of that terminal. TCP ports are refused: what listens
    there cannot be known.

    Raises:
        CommandRejectedError: `not_simulated`.
    """
    truth = await uav.sim.truth.latest()
    state = await uav.link.state.latest()
    if truth is None or truth.age > TRUTH_AGE:
        raise refuse(Token.NOT_SIMULATED, detail="no simulator serves this vehicle")
    if state is None:
        raise refuse(Token.NOT_SIMULATED, detail="the daemon does not say which port it has open")
    held, opened = _place(truth.value), _place(state.value)
    if not held[1] or held != opened:
        detail = f"the daemon's port is {state.value.port}, the simulator's {truth.value.port or 'unknown'}"
        raise refuse(Token.NOT_SIMULATED, detail=detail)


def _place(value: SimTruth | LinkState) -> tuple[str, str]:
    """Boot of the machine, and the path of a pseudo terminal; empty where it is none."""
    path = (value.port or "").removeprefix("pty:")
    return str(value.stamp.boot), path if path.startswith("/dev/pts/") else ""


async def watch_simulator(uav: Vehicle) -> None:
    """Check it again and again.

    Raises:
        CommandRejectedError: `not_simulated`, at the first time that it is not.
    """
    while True:
        await require_simulator(uav)
        await asyncio.sleep(CHECKING)
