"""A route on a NaviCtrl: what starts it over the serial line, and what only the pilot's GPS switch does.

A NaviCtrl 0.24 flies a list only where a point was received in flight while no list was active: that makes the list
active, and the next turn of the GPS switch to coming home flies it. Newer ones fly whatever list they hold.
Source: docs/firmware-notes, "A NaviCtrl 0.24 in flight".
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.flags import PositionStatus
from mkdaemon.protocol.messages import WaypointCount
from mkdaemon.protocol.procedures.points import PointFormat
from mkdaemon.protocol.procedures.steps import Patience, Procedure, Progress, insist, insist_twice
from mkdaemon.protocol.procedures.waypoint_list import ask_point, count_points, is_same_point, point_within, write_point
from mkdaemon.telemetry.refusals import Token, refuse

ACTIVATES_IN_FLIGHT: Final = (2, 0)
"""Releases before this one fly only a list that was activated in flight."""
SWITCH_024: Final = (
    "the GPS switch, turned to coming home, flies the list from its first point (one that stands there already must be "
    "turned away and back); turned away it pauses the list, and back it goes on; after the last point the aircraft "
    "flies home"
)
SWITCH_2X: Final = (
    "the GPS switch, turned to coming home, flies the list from its first point; turned away it ends it (taken from "
    "the documentation of NaviCtrl 2.x, not verified)"
)
"""What the pilot's switch does from now on."""


def switch_words(form: PointFormat) -> str:
    """Effect of the pilot's GPS switch on a list that is ready."""
    return SWITCH_024 if form.release < ACTIVATES_IN_FLIGHT else SWITCH_2X


def activate_route(form: PointFormat, patience: Patience) -> Procedure[int]:
    """Make the list on the board ready to be flown by the GPS switch; returns how many points it has.

    Writes its first point again, as it stands, which activates the list on a board that needs that.

    Args:
        form: how the board writes points.
        patience: how long to insist on each answer.

    Raises:
        RequestTimeoutError: no answer.
        CommandRejectedError: `no_route`: the board holds no points; `not_verified`; `list_changing`.
    """
    count = yield from count_points(patience)
    if count == 0:
        raise refuse(Token.NO_ROUTE)
    if form.release >= ACTIVATES_IN_FLIGHT:
        return count
    yield Progress(0, 2, "reading point 1")
    stored = yield from insist_twice(ask_point(1), patience)
    if isinstance(stored, WaypointCount):
        raise refuse(Token.LIST_CHANGING, before=count, after=stored.count)
    point = form.kind.decode(point_within(stored)).model_copy(update={"status": PositionStatus.NEW})
    yield Progress(1, 2, "writing point 1 again")
    yield from insist(write_point(point, 1), patience)
    after = yield from insist_twice(ask_point(1), patience)
    is_kept = not isinstance(after, WaypointCount) and is_same_point(point.encode(), point_within(after))
    if not is_kept or (yield from count_points(patience)) != count:
        raise refuse(Token.NOT_VERIFIED, rounds=1, where="point 1")
    return count
