"""How a procedure can fail, besides silence: one table of names, reasons and fixes."""

from __future__ import annotations

from typing import Final, NamedTuple

from mkdaemon.errors import CommandRejectedError


class Failure(NamedTuple):
    """One way to fail; both sentences may name `{words}` that are filled in."""

    reason: str
    fix: str


FAILURES: Final = {
    "not_cleared": Failure(
        "the NaviCtrl still holds {count} points after the list was cleared {rounds} times.",
        "Check that no other program uploads; then repeat.",
    ),
    "point_refused": Failure(
        "the NaviCtrl refused point {number} of {total} (it answered 0 and still holds {count} points).",
        "Shorten the mission: NaviCtrl 0.24 holds 31 points.",
    ),
    "not_verified": Failure(
        "after {rounds} rounds the NaviCtrl still holds something else at {where}; do not fly this list.",
        "Improve the line (`mkctl health`), then upload again; `mkctl waypoints clear` empties the list.",
    ),
    "list_changing": Failure(
        "the waypoint list changed while it was read ({before} points, then {after}).",
        "End the other program that uploads, then repeat.",
    ),
    "too_many_points": Failure(
        "the mission has {count} points and this board holds {limit}.",
        "Split the mission, or take points out.",
    ),
    "point_not_expressible": Failure(
        "point {number}: {detail}.",
        "Change the point; docs/waypoints.md shows what each NaviCtrl release can express.",
    ),
    "unknown_navictrl": Failure(
        "the points of NaviCtrl {release} are not documented.",
        "Nothing was sent; docs/protocol.md lists the releases this version knows.",
    ),
    "unknown_revision": Failure(
        "parameter sets of revision {revision} ({size} bytes) are not known for FlightCtrl {release}.",
        "They can be backed up as raw bytes, not edited or restored; nothing was written.",
    ),
    "revision_differs": Failure(
        "the file holds revision {wanted} and the FlightCtrl speaks revision {present}.",
        "Restore to the firmware the backup was made with; nothing was written.",
    ),
    "length_differs": Failure(
        "the file holds {wanted} bytes for a parameter set and the FlightCtrl sends {present}.",
        "The file is damaged or from another firmware; nothing was written.",
    ),
    "live_set_changed": Failure(
        "the active parameter set {slot} is not what it was before: {where}.",
        "Do not fly; restore the set from a backup and compare.",
    ),
    "live_set_unproven": Failure(
        "reading stopped ({cause}), and set {slot} could not be made live again for certain.",
        "Do not fly: the daemon makes it live again as soon as the FlightCtrl answers; repeat on a better line.",
    ),
    "active_set_moved": Failure(
        "the FlightCtrl says set {present} is active, and set {wanted} was before.",
        "Choose the set on the transmitter or restore again; do not fly before.",
    ),
    "write_refused": Failure(
        "the FlightCtrl refused to store set {slot} (it answered 0).",
        "Stop the motors; check that the set was made for this firmware.",
    ),
    "mixer_refused": Failure(
        "the FlightCtrl refused the mixer: it speaks another revision.", "Nothing was stored; save its mixer first."
    ),
    "mixer_differs": Failure(
        "the FlightCtrl holds another mixer than was sent ({where}).", "Do not fly; store the mixer again and compare."
    ),
    "motor_controller_refused": Failure(
        "motor controller {motor}: {status}.",
        "Check that the motors are off and that the controller is a BL-Ctrl 2.0 or later.",
    ),
    "motor_controller_differs": Failure("motor controller {motor}: {where}.", "Do not fly; set it again and compare."),
    "labels_inconsistent": Failure(
        "the labels read do not have the checksum the {board} tells ({found:#04x}, not {wanted:#04x}).",
        "Read them again on a better line.",
    ),
}
"""By token; stable words that scripts may test for."""


def fail(token: str, **words: object) -> CommandRejectedError:
    """Make the failure `token`, its sentences filled in.

    Raises:
        KeyError: the table has no such failure, or it names a word that is not given.
    """
    failure = FAILURES[token]
    return CommandRejectedError(token, failure.reason.format(**words), failure.fix.format(**words))
