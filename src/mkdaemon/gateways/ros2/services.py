"""The table of services: a name, its type, and the verb of the daemon behind it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

import structlog

from mkdaemon.client import Vehicle
from mkdaemon.errors import MkError
from mkdaemon.gateways.ros2.deck import FlightDeck
from mkdaemon.gateways.ros2.diagnostics import status_of
from mkdaemon.gateways.ros2.messages import ConversionScene
from mkdaemon.gateways.ros2.parameters import BoardSettings
from mkdaemon.reading.diagnoses import Diagnosis, DiagnosticLevel, diagnosis_of
from mkdaemon.telemetry.preflight import CheckState, PreflightReport

TRIGGER: Final = "std_srvs/srv/Trigger"
SET_BOOL: Final = "std_srvs/srv/SetBool"
SELF_TEST: Final = "diagnostic_msgs/srv/SelfTest"
SET_MODE: Final = "mavros_msgs/srv/SetMode"
"""Not among the wheels: offered where a ROS of one's own has it."""


@dataclass(frozen=True, slots=True)
class Desk:
    """What verbs act on.

    Attributes:
        uav: the daemon's client.
        deck: chooses the command source.
        scene: makes messages.
        settings: of the FlightCtrl, as parameters.
    """

    uav: Vehicle
    deck: FlightDeck
    scene: ConversionScene
    settings: BoardSettings


_log: Final = structlog.get_logger("gateway.ros2")
Fields = dict[str, Any]
Serve = Callable[[Desk, Any], Awaitable[Fields]]
"""Takes a request, returns the fields of its response."""


@dataclass(frozen=True, slots=True)
class Service:
    """One row.

    Attributes:
        name: below the vehicle's namespace.
        type: of the service.
        serve: does it.
        flies: it takes the lease; not offered where the parameter `commands` is off.
    """

    name: str
    type: str
    serve: Serve
    flies: bool = False


def _worded(act: Callable[[Desk], Awaitable[Any]], words: str = "{}") -> Serve:
    """A Trigger whose message has what the verb returns."""

    async def serve(desk: Desk, _: Any) -> Fields:
        return {"success": True, "message": words.format(await act(desk))}

    return serve


async def _preflight(desk: Desk, _: Any) -> Fields:
    report = await desk.uav.preflight()
    return {"success": report.is_ready, "message": preflight_words(report)}


async def _self_test(desk: Desk, _: Any) -> Fields:
    report = await desk.uav.preflight()
    status = [status_of(desk.scene, diagnosis_of(finding)) for finding in report.findings]
    passed = desk.scene.types.octet(int(report.is_ready))
    return {"id": desk.scene.vehicle, "passed": passed, "status": status}


async def _route_start(desk: Desk, request: Any) -> Fields:
    started = await desk.uav.route.start(confirm=bool(request.data))
    return {"success": True, "message": f"{started.count} points; {started.switch}"}


async def _route_end(desk: Desk, request: Any) -> Fields:
    await desk.uav.route.end(confirm=bool(request.data))
    return {"success": True, "message": "the list is empty"}


_MODES: Final[dict[str, Callable[[Desk], Awaitable[Any]]]] = {
    "AUTO.TAKEOFF": lambda desk: desk.deck.take_off(),
    "AUTO.LOITER": lambda desk: desk.deck.hold(),
    "AUTO.LAND": lambda desk: desk.deck.land(),
    "AUTO.MISSION": lambda desk: desk.uav.route.start(confirm=True),
    "STABILIZED": lambda desk: desk.deck.release(),
}
"""Modes as MAVROS names those of PX4, and the verb that is as near as can be."""


async def _set_mode(desk: Desk, request: Any) -> Fields:
    act = _MODES.get(request.custom_mode)
    if act is None:
        raise MkError(f"mode {request.custom_mode!r}: there is {', '.join(_MODES)}")
    await act(desk)
    return {"mode_sent": True}


_ABORTED: Final = "aborted: the aircraft holds its place, or is level without a target"
_STOPPED: Final = "asked to stop; only telemetry shows whether the motors have stopped"

SERVICES: Final = (
    Service("take_off", TRIGGER, _worded(lambda desk: desk.deck.take_off()), flies=True),
    Service("hold", TRIGGER, _worded(lambda desk: desk.deck.hold()), flies=True),
    Service("land", TRIGGER, _worded(lambda desk: desk.deck.land()), flies=True),
    Service("release", TRIGGER, _worded(lambda desk: desk.deck.release())),
    Service("abort", TRIGGER, _worded(lambda desk: desk.uav.abort("asked for in ROS"), _ABORTED)),
    Service("stop", TRIGGER, _worded(lambda desk: desk.uav.stop(), _STOPPED)),
    Service("preflight", TRIGGER, _preflight),
    Service("self_test", SELF_TEST, _self_test),
    Service("route_start", SET_BOOL, _route_start),
    Service("route_end", SET_BOOL, _route_end),
    Service("mark", TRIGGER, _worded(lambda desk: desk.uav.records.mark("marked in ROS"), "marked")),
    Service("set_mode", SET_MODE, _set_mode, flies=True),
    Service("param/pull", TRIGGER, _worded(lambda desk: desk.settings.pull(), "{} settings are parameters")),
    Service("cancel", TRIGGER, _worded(lambda desk: desk.uav.cancel(), "{0.verb} was ended")),
)
"""Every service; a further one is one row. docs/ros.md says what each does."""


async def answer(service: Service, desk: Desk, request: Any) -> Fields:
    """Do what a service is for; a refusal becomes its response.

    Args:
        service: which.
        desk: what it acts on.
        request: as it came.
    """
    try:
        return await service.serve(desk, request)
    except MkError as error:
        return refused(service, desk.scene, str(error))


def refused(service: Service, scene: ConversionScene, reason: str) -> Fields:
    """Fields of the response of a service that was refused."""
    if service.type == SET_MODE:
        _log.warning("mode_refused", words=reason)  # the response has no room for words
        return {"mode_sent": False}
    if service.type == SELF_TEST:
        status = status_of(scene, Diagnosis(service.name, DiagnosticLevel.ERROR, reason, {}))
        return {"id": scene.vehicle, "passed": scene.types.octet(0), "status": [status]}
    return {"success": False, "message": reason}


def preflight_words(report: PreflightReport) -> str:
    """What is in the way, a line each; one line where nothing is."""
    standing = [finding for finding in report.findings if finding.state is CheckState.STANDS]
    lines = [f"{finding.name}: {finding.reason} {finding.fix}".strip() for finding in standing]
    return "\n".join(lines) or "nothing is in the way"
