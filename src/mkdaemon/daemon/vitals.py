"""Whether the vehicle is alive, from what is known about it and about its line."""

from __future__ import annotations

from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.link.link import Link
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.link import LinkCondition
from mkdaemon.telemetry.state import Flight
from mkdaemon.telemetry.vehicle import VehicleHealth


def vehicle_health(
    facts: VehicleFacts, link: Link, stamp: Stamp, *, note: str, open_endpoints: tuple[str, ...] = ()
) -> VehicleHealth:
    """Return the vehicle's signs of life at a moment.

    Args:
        facts: what is known about the vehicle.
        link: the line.
        stamp: the moment.
        note: of the configuration.
        open_endpoints: endpoints open to the whole network.
    """
    state, flight = facts.link, facts.newest(Flight, stamp.monotonic)
    return VehicleHealth(
        stamp=stamp,
        is_alive=state is not None and state.condition.hears_board,
        reason="the line has not been opened yet" if state is None else state.reason,
        boards=() if state is None else state.boards,
        firmware={board.word: release for board, release in link.firmware.items()},
        read_only=link.dialect.read_only_reason,
        link=(LinkCondition.ABSENT if state is None else state.condition).value,
        motors_running=facts.motors_running(stamp.monotonic),
        error=None if flight is None else flight.error or None,
        note=note,
        battery_cells=facts.cells,
        open_endpoints=open_endpoints,
    )


def status_line(health: VehicleHealth, phase: Phase) -> str:
    """Return one line: the link, the motors, the phase of control.

    Args:
        health: the vehicle's signs of life.
        phase: where authority stands.
    """
    motors = {True: "motors running", False: "motors stopped", None: "motors unknown"}[health.motors_running]
    words = [f"link {health.link}: {health.reason}", motors, f"control {phase}"]
    if health.error is not None:
        words.append(f"error: {health.error}")
    return "; ".join(words)
