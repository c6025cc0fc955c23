"""Every procedure that is a verb, in one table: what it needs, how it is made.

Requests and replies stand beside the verbs in the table of keys (`mkdaemon.bus.keys`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from mkdaemon.bus.keys import find
from mkdaemon.control.admission.beginnings import Beginning, ListUpload, NaviGoto, StartRoute
from mkdaemon.daemon.procedures import make
from mkdaemon.protocol.procedures.steps import Procedure
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.mission import WaypointsUploadRequest
from mkdaemon.telemetry.procedure import ProcedureRequest
from mkdaemon.telemetry.state import Position


@dataclass(frozen=True, slots=True)
class ProcedureSpec:
    """One procedure.

    Attributes:
        board: the addressee.
        make: makes the procedure for a request.
        is_alone: motors must be off and nothing may fly, unless the request says `in_flight`.
        writes: what is written, in words; the request must say `confirm`, unless it is a dry run.
        needs_live_set: it must not begin while a live set is owed.
        changes_list: it leaves the waypoint list half written when it is cut off.
        begins: what the NaviCtrl is to fly with it, for admission; None for nothing.
        prepare: returns what `make` takes, from the request and where the aircraft is by GPS.
    """

    board: Board
    make: Callable[[Any], Procedure[Telemetry]]
    is_alone: bool = True
    writes: str | None = None
    needs_live_set: bool = False
    changes_list: bool = False
    begins: Callable[[Any], Beginning | None] = lambda request: None
    prepare: Callable[[Any, Position | None], Any] = lambda request, position: request


def _upload(request: WaypointsUploadRequest) -> ListUpload:
    return ListUpload(request.points, request.allow_unusual)


_settings = partial(ProcedureSpec, Board.FC, needs_live_set=True)

PROCEDURES: Final[Mapping[str, ProcedureSpec]] = {
    "settings_backup": _settings(make.settings_backup),
    "settings_compare": _settings(make.settings_compare),
    "settings_restore": _settings(
        make.settings_restore,
        writes="parameter sets decide how the aircraft flies",
    ),
    "settings_write": _settings(
        make.settings_write,
        writes="parameters decide how the aircraft flies",
    ),
    "waypoints_upload": ProcedureSpec(Board.NC, make.waypoints_upload, changes_list=True, begins=_upload),
    "waypoints_clear": ProcedureSpec(Board.NC, make.waypoints_clear, changes_list=True),
    "waypoints_read": ProcedureSpec(Board.NC, make.waypoints_read, is_alone=False),
    "waypoints_verify": ProcedureSpec(Board.NC, make.waypoints_verify, is_alone=False),
    "route_start": ProcedureSpec(
        Board.NC,
        make.route_start,
        is_alone=False,
        writes="the aircraft flies the list by itself when the pilot turns the GPS switch to coming home",
        begins=lambda request: StartRoute(),
    ),
    "route_end": ProcedureSpec(
        Board.NC,
        make.route_end,
        is_alone=False,
        writes="with the GPS switch at coming home the aircraft flies home at once",
        changes_list=True,
    ),
    "navi_goto": ProcedureSpec(
        Board.NC,
        make.navi_goto,
        is_alone=False,
        writes="the aircraft flies there by itself when the pilot turns the GPS switch to coming home",
        changes_list=True,
        begins=lambda request: NaviGoto(request.position[2]),
        prepare=make.target_point,
    ),
    "mixer_read": ProcedureSpec(Board.FC, make.mixer_read, is_alone=False),
    "mixer_write": ProcedureSpec(
        Board.FC,
        make.mixer_write,
        writes="a wrong mixer flips the aircraft",
        needs_live_set=True,
    ),
    "motor_controllers_read": ProcedureSpec(Board.FC, make.motor_controllers_read),
    "motor_controllers_write": ProcedureSpec(
        Board.FC,
        make.motor_controllers_write,
        writes="a wrong sense of rotation or limit crashes the aircraft",
    ),
}
"""By verb."""


def request_model(verb: str) -> type[ProcedureRequest]:
    """Request model of a procedure.

    Raises:
        ValueError: the table of keys has no such verb, or another kind of request for it.
    """
    spec = find(f"do/{verb}")
    if spec is None or spec.carries is None or not issubclass(spec.carries, ProcedureRequest):
        msg = f"do/{verb} is not a procedure of the table in bus/keys.py"
        raise ValueError(msg)
    return spec.carries
