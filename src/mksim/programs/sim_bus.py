"""The simulator on the bus: true state and faults under `mk/<vehicle>/sim/`.

The simulator's session is a client of the daemon. Without a daemon the simulator flies on and tries again.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator

import structlog
import zenoh
from pydantic import BaseModel

from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.codec import encode, encoding_of, read_command, schema_name, with_age
from mkdaemon.bus.names import key
from mkdaemon.clock import Clock
from mkdaemon.errors import CommandRejectedError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.sim import FaultAction, FaultRequest, RunningFault, SimFaults, SimTruth
from mkdaemon.telemetry.status import Status
from mksim.config import SimConfig
from mksim.programs.sim_camera import CameraPublisher
from mksim.programs.sim_mocap import report_positions
from mksim.programs.simsession import check_endpoints, stay_connected
from mksim.runtime import running
from mksim.simulation import Simulation

_log = structlog.get_logger(__name__)
_FAULTS_PERIOD = 1.0
TRUTH = "sim/truth"
FAULTS = "sim/faults"
FAULT = "sim/fault"
START = "sim/start"


def truth_of(simulation: Simulation, stamp: Stamp, port: str = "") -> SimTruth:
    """The true state now.

    Args:
        simulation: the aircraft.
        stamp: the time.
        port: pseudo terminal it is served on.
    """
    truth, core = simulation.world.truth, simulation.flight.core
    east, north, up = truth.position_enu.tolist()
    setpoints = simulation.world.sensors.motor_setpoints
    return SimTruth(
        stamp=stamp,
        t=simulation.now,
        position_enu=(east, north, up),
        velocity_enu=tuple(truth.velocity_enu.tolist()),
        enu_from_flu=truth.quaternion,
        rates=tuple(truth.rates.tolist()),
        wind_enu=tuple(truth.wind_enu.tolist()),
        airborne=truth.airborne,
        crashed=truth.crashed,
        crash_reason=truth.crash_reason,
        motors_running=core.running,
        controlled=core.controlled,
        gate_open=core.gate_open,
        motor_setpoints=(setpoints[0], setpoints[1], setpoints[2], setpoints[3]),
        port=port,
        pilot=simulation.pilot_doing,
    )


def faults_of(simulation: Simulation, stamp: Stamp) -> SimFaults:
    """The faults that run now."""
    return SimFaults(
        stamp=stamp,
        t=simulation.now,
        active={
            name: RunningFault(
                values=fault.values, began=fault.began, ends=None if math.isinf(fault.ends) else fault.ends
            )
            for name, fault in simulation.world.faults.active.items()
        },
    )


def apply_fault_request(simulation: Simulation, request: FaultRequest, stamp: Stamp) -> CommandResult:
    """Do what a fault request asks; the answer lists what runs then.

    Raises:
        CommandRejectedError: no such fault or parameter, or a value out of range.
    """
    faults = simulation.world.faults
    if request.action is FaultAction.START:
        faults.start(request.name, duration=request.duration, **request.values)
    elif request.action is FaultAction.STOP:
        faults.stop(request.name)
    elif request.action is FaultAction.CLEAR:
        faults.clear()
    _log.info("fault", action=request.action.value, name=request.name, t=round(simulation.now, 3))
    reply = faults_of(simulation, stamp).model_dump()
    return CommandResult(status=Status.ACCEPTED, reply=reply, reply_type=schema_name(SimFaults))


class SimBus:
    """One open session."""

    def __init__(self, session: zenoh.Session, simulation: Simulation, vehicle: str, port: str) -> None:
        self._session = session
        self._simulation = simulation
        self._vehicle = vehicle
        self._port = port
        self._clock = Clock()
        self._last: dict[str, tuple[BaseModel, float]] = {}
        self._publishers = {
            suffix: session.declare_publisher(key(vehicle, suffix), congestion_control=zenoh.CongestionControl.DROP)
            for suffix in (TRUTH, FAULTS)
        }
        loop = asyncio.get_running_loop()

        def on_query(query: zenoh.Query) -> None:
            loop.call_soon_threadsafe(self._answer, query)

        handler = direct(on_query)
        session.declare_queryable(key(vehicle, "sim/*"), handler)

    async def publish(self, rate_hz: float) -> None:
        """Put truth at a rate, and the faults every second and on change, for ever."""
        faults = self._simulation.world.faults
        seen, next_faults, doing = -1, 0.0, ""
        period = 1.0 / rate_hz if rate_hz else _FAULTS_PERIOD
        while True:
            if rate_hz:
                self._put(TRUTH, truth_of(self._simulation, self._clock.stamp(), self._port))
            if doing != self._simulation.pilot_doing:
                doing = self._simulation.pilot_doing
                _log.info(f"the pilot {doing}", t=round(self._simulation.now, 3))
            now = time.monotonic()
            if faults.generation != seen or now >= next_faults:
                seen, next_faults = faults.generation, now + _FAULTS_PERIOD
                self._put(FAULTS, faults_of(self._simulation, self._clock.stamp()))
            await asyncio.sleep(period)

    def _put(self, suffix: str, value: BaseModel) -> None:
        self._last[suffix] = (value, time.monotonic())
        self._publishers[suffix].put(encode(value), encoding=encoding_of(type(value)))

    def _answer(self, query: zenoh.Query) -> None:
        """Reply with last values; carry out a request addressed to exactly its key."""
        with query:
            for suffix, carry_out in ((FAULT, self._handle_fault_request), (START, self._start_pilot)):
                own = key(self._vehicle, suffix)
                if str(query.key_expr) == own:
                    query.reply(own, encode(carry_out(query)), encoding=encoding_of(CommandResult))
                    return
            for suffix, (value, stamp) in self._last.items():
                whole = key(self._vehicle, suffix)
                if query.key_expr.intersects(whole):
                    payload = with_age(encode(value), time.monotonic() - stamp)
                    query.reply(whole, payload, encoding=encoding_of(type(value)))

    def _start_pilot(self, query: zenoh.Query) -> CommandResult:
        self._simulation.start_pilot()
        _log.info("pilot asked to begin", t=round(self._simulation.now, 3))
        reply = truth_of(self._simulation, self._clock.stamp(), self._port)
        return CommandResult(status=Status.ACCEPTED, reply=reply.model_dump(), reply_type=schema_name(SimTruth))

    def _handle_fault_request(self, query: zenoh.Query) -> CommandResult:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            return apply_fault_request(self._simulation, read_command(FaultRequest, payload), self._clock.stamp())
        except CommandRejectedError as error:
            return refused(error)


@contextlib.asynccontextmanager
async def sim_on_bus(
    simulation: Simulation,
    config: SimConfig,
    vehicle: str,
    publisher: CameraPublisher | None = None,
    *,
    port: str = "",
) -> AsyncIterator[None]:
    """Be on the bus, whenever a daemon listens, while the context lasts.

    Args:
        simulation: the aircraft.
        config: where it connects to, and how often it speaks.
        vehicle: its name.
        publisher: of the images; None for no camera.
        port: pseudo terminal it is served on; shows that a daemon's port is a simulator's.

    Raises:
        ConfigError: an endpoint cannot be understood.
    """
    check_endpoints(config.connect)

    async def serve(session: zenoh.Session) -> None:
        with publisher.open(session) if publisher is not None else contextlib.nullcontext():
            async with asyncio.TaskGroup() as tasks:
                if config.mocap.enabled:
                    tasks.create_task(report_positions(session, simulation, config, vehicle), name="motion capture")
                await SimBus(session, simulation, vehicle, port).publish(config.truth_rate_hz)

    async with running(stay_connected(config.connect, serve), "simulator on the bus"):
        yield
