"""How a procedure on the boards can fail, besides silence: the part of the table of refusals that is theirs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mkdaemon.telemetry.tokens import Refusal, Status, Token

FAILURES: Final[Mapping[str, Refusal]] = {
    Token.BAD_VALUE: Refusal(Status.DENIED, "{detail}.", "`mkctl settings show` lists names and values."),
    Token.FLYING: Refusal(
        Status.DENIED,
        "{name} and flying exclude each other, and control is {phase}.",
        "Give the lease back (`mkctl lease release`), stop the motors, repeat.",
    ),
    Token.IN_FLIGHT_NEEDED: Refusal(
        Status.DENIED,
        "{detail}, and {name} takes effect at once.",
        "Land and stop the motors, or repeat with `in_flight` (`--in-flight`), knowing what it does.",
    ),
    Token.MOTORS_STARTED: Refusal(
        Status.DENIED,
        "motors have started during {name}, or nobody knows any more: what was begun may be incomplete.",
        "Land, stop the motors, repeat.",
    ),
    Token.LIST_INCOMPLETE: Refusal(
        Status.DENIED,
        "{detail}; the board's list may be incomplete.",
        "Repeat the upload, or empty the list: `mkctl waypoints clear`.",
    ),
    Token.LIVE_SET_OWED: Refusal(
        Status.DENIED,
        "{verb} was cut off, and parameter set {slot}, live before it, is not proven to be live again, so {name} must "
        "wait: {detail}.",
        "Stop the motors: it is restored as soon as the FlightCtrl answers; `mkctl settings recover` looks after it.",
    ),
    Token.JOURNAL_UNWRITABLE: Refusal(
        Status.DENIED,
        "the live parameter set cannot be noted for the case that the daemon dies: {detail}.",
        "Make the folder writable, or set vehicle.state_folder in the configuration.",
    ),
    Token.CANCELLED: Refusal(
        Status.DENIED, "{name} was cancelled: {detail}.", "Repeat it; what was half written stays so until then."
    ),
    Token.NO_PROCEDURE: Refusal(
        Status.DENIED, "no such procedure is under way.", "`mkctl get event/progress` shows the last."
    ),
    Token.PROCEDURE_FAILED: Refusal(Status.DENIED, "{name} failed: {detail}.", "Check `mkctl health`, then repeat it."),
    Token.NOT_CLEARED: Refusal(
        Status.DENIED,
        "the NaviCtrl still holds {count} points after the list was cleared {rounds} times.",
        "Check that no other program uploads; then repeat.",
    ),
    Token.POINT_REFUSED: Refusal(
        Status.DENIED,
        "the NaviCtrl refused point {number} of {total} (it answered 0 and still holds {count} points).",
        "Shorten the mission: NaviCtrl 0.24 holds 31 points.",
    ),
    Token.NOT_VERIFIED: Refusal(
        Status.DENIED,
        "after {rounds} rounds the NaviCtrl still holds something else at {where}; do not fly this list.",
        "Improve the line (`mkctl health`), then upload again; `mkctl waypoints clear` empties the list.",
    ),
    Token.LIST_CHANGING: Refusal(
        Status.DENIED,
        "the waypoint list changed while it was read ({before} points, then {after}).",
        "End the other program that uploads, then repeat.",
    ),
    Token.TOO_MANY_POINTS: Refusal(
        Status.DENIED,
        "the mission has {count} points and this board holds {limit}.",
        "Split the mission, or take points out.",
    ),
    Token.POINT_NOT_EXPRESSIBLE: Refusal(
        Status.DENIED,
        "point {number}: {detail}.",
        "Change the point; docs/waypoints.md shows what each NaviCtrl release can express.",
    ),
    Token.POINT_UNUSUAL: Refusal(
        Status.DENIED,
        "point {number} {detail}.",
        "Correct the point, or repeat with `allow_unusual` (`--allow-unusual`), knowing why.",
    ),
    Token.NO_ROUTE: Refusal(
        Status.DENIED, "the NaviCtrl holds no points.", "Upload a mission first: `mkctl waypoints upload FILE`."
    ),
    Token.ROUTE_ON_GROUND: Refusal(
        Status.DENIED,
        "a route is started in flight, and {detail}: a NaviCtrl 0.24 flies home with a list activated on the ground.",
        "Take off by hand, then repeat.",
    ),
    Token.ROUTE_ACTIVE: Refusal(
        Status.DENIED,
        "the list is active already, at point {index} of {count}.",
        "The pilot's GPS switch at coming home flies it; `mkctl route end` ends it.",
    ),
    Token.SWITCH_AT_HOME: Refusal(
        Status.DENIED,
        "the pilot's GPS switch is at coming home: a list that changes now is flown at once, or ends in a flight home.",
        "The pilot turns the GPS switch to hold or free; repeat, then he turns it to coming home.",
    ),
    Token.POSITION_POOR: Refusal(
        Status.DENIED,
        "the NaviCtrl's position is not good enough to be flown by: {detail}.",
        "Start the motors under open sky with a fix, for that sets home; over a target fly with `--frame pad`.",
    ),
    Token.PILOTS_SWITCH: Refusal(
        Status.UNSUPPORTED,
        "nothing on the serial line pauses a route.",
        "Turn the GPS switch away from coming home: position hold stays there, free flies by hand; a NaviCtrl 0.24 "
        "goes on when the switch is turned back.",
    ),
    Token.UNKNOWN_NAVICTRL: Refusal(
        Status.DENIED,
        "the points of NaviCtrl {release} are not documented.",
        "Nothing was sent; docs/protocol.md lists the releases this version knows.",
    ),
    Token.UNKNOWN_REVISION: Refusal(
        Status.DENIED,
        "parameter sets of revision {revision} ({size} bytes) are not known for FlightCtrl {release}.",
        "They can be backed up as raw bytes, not edited or restored; nothing was written.",
    ),
    Token.REVISION_DIFFERS: Refusal(
        Status.DENIED,
        "the file holds revision {wanted} and the FlightCtrl speaks revision {present}.",
        "Restore to the firmware the backup was made with; nothing was written.",
    ),
    Token.LENGTH_DIFFERS: Refusal(
        Status.DENIED,
        "the file holds {wanted} bytes for a parameter set and the FlightCtrl sends {present}.",
        "The file is damaged or from another firmware; nothing was written.",
    ),
    Token.LIVE_SET_CHANGED: Refusal(
        Status.DENIED,
        "the active parameter set {slot} is not what it was before: {where}.",
        "Do not fly; restore the set from a backup and compare.",
    ),
    Token.LIVE_SET_UNPROVEN: Refusal(
        Status.DENIED,
        "reading stopped ({cause}), and set {slot} could not be made live again for certain.",
        "Do not fly: the daemon makes it live again as soon as the FlightCtrl answers; repeat on a better line.",
    ),
    Token.ACTIVE_SET_MOVED: Refusal(
        Status.DENIED,
        "the FlightCtrl says set {present} is active, and set {wanted} was before.",
        "Choose the set on the transmitter or restore again; do not fly before.",
    ),
    Token.WRITE_REFUSED: Refusal(
        Status.DENIED,
        "the FlightCtrl refused to store set {slot} (it answered 0).",
        "Stop the motors; check that the set was made for this firmware.",
    ),
    Token.MIXER_REFUSED: Refusal(
        Status.DENIED,
        "the FlightCtrl refused the mixer: it speaks another revision.",
        "Nothing was stored; save its mixer first.",
    ),
    Token.MIXER_DIFFERS: Refusal(
        Status.DENIED,
        "the FlightCtrl holds another mixer than was sent ({where}).",
        "Do not fly; store the mixer again and compare.",
    ),
    Token.MOTOR_CONTROLLER_REFUSED: Refusal(
        Status.DENIED,
        "motor controller {motor}: {status}.",
        "Check that the motors are off and that the controller is a BL-Ctrl 2.0 or later.",
    ),
    Token.MOTOR_CONTROLLER_DIFFERS: Refusal(
        Status.DENIED, "motor controller {motor}: {where}.", "Do not fly; set it again and compare."
    ),
    Token.LABELS_INCONSISTENT: Refusal(
        Status.DENIED,
        "the labels read do not have the checksum the {board} tells ({found:#04x}, not {wanted:#04x}).",
        "Read them again on a better line.",
    ),
}
"""Part of `REFUSALS`."""
