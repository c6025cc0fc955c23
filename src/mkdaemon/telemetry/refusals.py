"""Every refusal of the whole program, declared once with its reason and its fix.

A client can know them all: docs/keys.md shows this table, and a test walks it.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Final, Self

from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.sentences import KnownWords
from mkdaemon.telemetry.status import Status


class Token(StrEnum):
    """Stable word of a refusal, by which programs know why a command was refused.

    Attributes:
        reason: why; may name `{words}` that the refusal fills in.
        fix: what to do about it; likewise.
        status: how the command ends.
    """

    reason: str
    fix: str
    status: Status

    def __new__(cls, word: str, reason: str, fix: str, status: Status = Status.DENIED) -> Self:
        """Declare one."""
        member = str.__new__(cls, word)
        member._value_ = word
        member.reason, member.fix, member.status = reason, fix, status
        return member

    # the request itself
    MALFORMED = (
        "malformed",
        "the request cannot be read: {detail}.",
        "Send a msgpack map; `mkctl board send --help` shows fields.",
    )
    BAD_FIELD = (
        "bad_field",
        "{name} does not take this: {detail}.",
        "`mkctl get schema/{name}.v1` shows fields and limits.",
    )
    UNKNOWN_MESSAGE = (
        "unknown_message",
        "{board} has no request {name!r}.",
        "Did you mean {near}? docs/protocol.md lists all.",
        Status.UNSUPPORTED,
    )
    UNKNOWN_VERB = (
        "unknown_verb",
        "there is no verb {name!r}.",
        "Did you mean {near}? See docs/keys.md.",
        Status.UNSUPPORTED,
    )
    UNSUPPORTED = (
        "unsupported",
        "this firmware does not know {name}: {detail}.",
        "docs/protocol.md lists the releases that do.",
        Status.UNSUPPORTED,
    )
    READ_ONLY = (
        "read_only",
        "the aircraft is read-only: {detail}.",
        "Connect a supported firmware (docs/limits.md); `mkctl status` shows what was found.",
    )
    DISCOVERING = (
        "discovering",
        "the aircraft is not identified yet: {detail}.",
        "The daemon asks the board again every few seconds while the motors are off; `mkctl status`.",
        Status.BUSY,
    )
    BUSY = ("busy", "{detail}.", "Try again when the first one has been answered.", Status.BUSY)
    INTERNAL = ("internal", "the daemon failed on it: {detail}.", "This is a defect; see the daemon's log.")

    # the line
    LINK_DOWN = (
        "link_down",
        "the link is {state}: {detail}.",
        "`mkctl health` shows the line; check cable, power, port.",
    )
    TIMEOUT = (
        "timeout",
        "{board} did not answer {name}: {detail}.",
        "Check `mkctl health`, then the conditions for {name} in docs/protocol.md: boards refuse by silence.",
        Status.TIMEOUT,
    )
    LINE_BUDGET = (
        "line_budget",
        "{terms} of the line; {limit:.0f} % is the limit.",
        "Make the intervals {factor:.1f} times longer, or stop a stream.",
    )
    UPLINK_BUDGET = (
        "uplink_budget",
        "setpoints at {hz:.0f} Hz, echoes and renewals need {share:.0f} % of the line towards the board.",
        "Lower the setpoint or echo rate.",
    )
    NO_SUCH_STREAM = ("no_such_stream", "{board} has no stream {name!r}.", "It has {known}.", Status.UNSUPPORTED)
    BOARD_UNREACHABLE = (
        "board_unreachable",
        "{board} cannot be reached from here: {detail}.",
        "Connect to it, or redirect the line first.",
    )
    NO_REPLY = ("no_reply", "{name} is never answered.", "Send it without waiting.", Status.UNSUPPORTED)
    RECORDING = (
        "recording",
        "a recording plays: there is no board.",
        "Connect an aircraft, or name it with --vehicle.",
    )
    NOT_REDIRECTABLE = (
        "not_redirectable",
        "the line cannot be passed through to {board}.",
        "Connect to that board directly.",
        Status.UNSUPPORTED,
    )
    MOTORS_NOT_KNOWN_OFF = (
        "motors_not_known_off",
        "a redirection stops the NaviCtrl's telemetry and servos.",
        "Stop the motors and wait for telemetry that confirms it.",
    )
    WRONG_LAYOUT = (
        "wrong_layout",
        "this FlightCtrl takes another external control than {given}.",
        "This is a defect of the program that built the frame; see the log.",
    )
    RELEASING = ("releasing", "a release is under way.", "Wait for its result.", Status.BUSY)
    UNCONFIRMED = (
        "unconfirmed",
        "the last release is not confirmed yet.",
        "Wait until it is, at most 6 s.",
        Status.BUSY,
    )
    BOARD_DEAF = (
        "board_deaf",
        "the line waits for {detail}.",
        "Wait up to 5 s; sticks then start from neutral.",
        Status.BUSY,
    )
    REMEMBERED_ONLY = (
        "remembered_only",
        "through a NaviCtrl the FlightCtrl cannot be identified in flight; before this start or reopening it was "
        "{firmware}, and flying time, charge and home show the same flight.",
        "Repeat with `use_remembered` (`mkctl lease take --use-remembered`) if it is, or land and stop the motors.",
    )
    NOTHING_REMEMBERED = (
        "nothing_remembered",
        "no stored flight matches the present telemetry.",
        "Repeat without `use_remembered`; land and stop the motors: then the FlightCtrl is identified.",
    )
    OTHER_AIRCRAFT = ("other_aircraft", "{port} came back with {detail}.", "Swap back, or `mkctl do accept-aircraft`.")
    AIRCRAFT_UNPROVEN = ("aircraft_unproven", "{port} came back, and {detail}.", "Or `mkctl do accept-aircraft`.")
    NO_OTHER_AIRCRAFT = ("no_other_aircraft", "no other aircraft is waiting.", "See `mkctl status`.")

    # dangers
    NOT_ENABLED = (
        "not_enabled",
        "{name} is off: {detail}.",
        "If you need it, set commands.{option} = true in the configuration.",
    )
    NOT_CONFIRMED = (
        "not_confirmed",
        "{name} is dangerous: {detail}.",
        "Repeat the request with `confirm` set to {confirm!r}.",
    )
    MOTORS_RUNNING = ("motors_running", "motors are running, and {detail}.", "Land, stop the motors, repeat.")
    MOTORS_UNKNOWN = (
        "motors_unknown",
        "no recent telemetry shows whether the motors run, and {detail}.",
        "Subscribe to the NaviCtrl's OSD data (`mkctl board rates osd 200ms`), or check the cable to the NaviCtrl.",
    )
    BOARD_UNPROVEN = (
        "board_unproven",
        "the last version reply does not prove that {board} is on the line ({detail}).",
        "`mkctl board send version-request --board {board}` first; behind a NaviCtrl redirect the line.",
    )
    NEVER = ("never", "{name} is never sent for a client: {detail}.", "{instead}")
    DEAF_TOO_LONG = (
        "deaf_too_long",
        "the FlightCtrl would not receive anything for {seconds:.0f} s; only power-off ends this.",
        "Reduce duration times count to {limit:g} s in all; pauses as long as the beeps count too.",
    )

    # authority
    NOT_LEASED = ("not_leased", "no client holds the lease.", "`mkctl lease take` first.")
    FLYING_STOP = (
        "flying_stop",
        "stopping the motors drops a flying aircraft, and no telemetry shows that it is on the ground.",
        "Land first; `mkctl release` returns it to the pilot; --in-flight stops the motors in the air.",
    )
    NOTHING_FLOWN = (
        "nothing_flown",
        "there is no manoeuvre to stop: {phase}.",
        "`mkctl release` returns the aircraft to the pilot at any time.",
    )
    LEASE_HELD = (
        "lease_held",
        "{holder} holds the lease for another {left:.1f} s.",
        "Ask the holder, or take it with `--force`.",
    )
    SLOW_PATH = (
        "slow_path",
        "the round trip to this client {took}, more than {limit:g} s: it delays every safety limit.",
        "Use a faster connection, or fly from the aircraft; or raise control.lease.max_path_delay (docs/security.md).",
    )
    WRONG_EPOCH = (
        "wrong_epoch",
        "epoch {epoch} is not the lease's epoch {current}.",
        "Take a lease and use the epoch it returns.",
    )
    NOT_HOLDER = (
        "not_holder",
        "it is not signed with the secret of the lease, which only {holder} has.",
        "Sign setpoints with the secret that `take` returned, and put them below its `setpoint_root`; docs/keys.md.",
    )
    STALE_SEQUENCE = (
        "stale_sequence",
        "sequence {sequence} is not after {last}.",
        "Count sequence up from one setpoint to the next.",
    )
    SETPOINT_LATE = (
        "setpoint_late",
        "the setpoint may be too old: {detail}.",
        "Send at most 50 a second, each with its stamp (docs/keys.md, Flying by sticks); or use a faster connection.",
    )
    SEQUENCE_JUMP = (
        "sequence_jump",
        "sequence {sequence} is more than {limit} after {last}.",
        "Count sequence up by one from one setpoint to the next.",
    )
    NO_GUIDANCE = (
        "no_guidance",
        "{name} cannot be flown: the daemon follows {known}.",
        "Stream one of these.",
        Status.UNSUPPORTED,
    )
    NO_ESTIMATE = (
        "no_estimate",
        "{name} needs the position of the aircraft, and no camera or source of poses has shown it yet.",
        "`mkctl watch 'vision/**'` shows what they see; [[cameras]] in the configuration needs one, calibrated, or "
        "[[positions]] a source.",
    )
    TARGET_UNCLEAR = (
        "target_unclear",
        "{name} would be flown by {found}, and {detail}.",
        "Name the target in the field `target` of the setpoint.",
    )
    PATH_REFUSED = (
        "path_refused",
        "the path cannot be flown: {detail}.",
        "{remedy}",
    )
    NO_PATH = (
        "no_path",
        "no path {path!r} is stored: the daemon has restarted since it was uploaded, or {kept} others came after it.",
        "Upload the path again (`do/path_upload`), and use the id of the answer; `lease.follow` does both.",
    )
    NO_FRAME = (
        "no_frame",
        "{name} cannot be flown in frame {frame}: GPS has an error of 2 to 3 m and does not report its age.",
        "Give it in frame pad or body; `mkctl goto X Y Z --frame home` (`do/navi_goto`) lets the NaviCtrl fly there.",
        Status.UNSUPPORTED,
    )
    NOT_READY = (
        "not_ready",
        "{name} cannot start from sticks or attitude now; it needs {detail}.",
        "Fly by sticks until the condition holds, then stream it again; docs/modes.md lists the conditions.",
    )
    NOT_FLYING = (
        "not_flying",
        "{name} needs an aircraft in the air: {detail}.",
        "Take off (`mkctl takeoff`), or let the pilot hover over the target; `mkctl watch state/flight` shows it.",
    )
    NO_ANSWER = (
        "no_answer",
        "the aircraft does not answer its sticks: {detail}; they are level now.",
        "The pilot flies. To hand over, hover still over the target, centre the sticks and open the gate; if it is "
        "open, check `mkctl health` and `mkctl settings show external_control`.",
    )
    NOT_ON_GROUND = (
        "not_on_ground",
        "a take-off starts on the ground, and this aircraft is flown by sticks or attitude.",
        "In the air stream hold or a position; on the ground `mkctl release`, take the lease again, then take off.",
    )
    GATE_SHUT = (
        "gate_shut",
        "the FlightCtrl ignores stick frames: ExternalControl of its active set is {value}, not above 128.",
        "Put it on a switch of the transmitter: `mkctl settings write external_control=poti1` (to poti8).",
    )
    GATE_CONSTANT = (
        "gate_constant",
        "no switch of the transmitter ends external control: ExternalControl of the active set is {value}, a constant.",
        "`mkctl settings write external_control=poti1`, or accept it: control.lease.allow_constant_gate = true.",
    )
    GATE_SWITCHES_ALTITUDE = (
        "gate_switches_altitude",
        "the switch that opens external control also turns height control on: HoeheChannel of the active set is "
        "{channel}, the gate's own channel, and height control is enabled (GlobalConfig bit 0).",
        "Put one of them on another channel: `mkctl settings write external_control=poti2`, or altitude_channel=0.",
    )
    NO_CONTROL = (
        "no_control",
        "external control is not possible: {detail}.",
        "`mkctl status` shows the firmware and the gate.",
    )
    GUARD_DEAD = (
        "guard_dead",
        "the guard process has ended: if the daemon died, nothing would release the aircraft.",
        'Restart the daemon; docs/safety.md, "The guard".',
    )

    # before a flight against a target
    LOOP_UNSTABLE = (
        "loop_unstable",
        "with {cause} the control loop is not safe for the model of this aircraft: {detail}.",
        "`mkctl preflight` shows the cause; {remedy}.",
    )
    GAIN_ON_POTI = (
        "gain_on_poti",
        "{parameter} = {value} of the active set refers to potentiometer {poti} of the transmitter, not to a number: "
        "the effect of a stick is unknown.",
        "Give it a number below 248: `mkctl settings write {parameter}=...`, motors off; or fly by sticks.",
    )
    GAIN_ZERO = (
        "gain_zero",
        "with {parameter} = {value} in the active set the aircraft does not follow its sticks as its model predicts.",
        "Give it a number above 0: `mkctl settings write {parameter}=...`, motors off; or fly by sticks.",
    )
    LINK_POOR = (
        "link_poor",
        "{lost:.0f} % of the link tests are not answered in time, more than {limit:g} %.",
        "`mkctl linktest` says what to change: the antennas, the channel, the distance, or a cable.",
    )
    HEIGHT_CONTROL = (
        "height_control",
        "with height control the throttle is a climb rate: {detail}.",
        "Clear the bit altitude_control of global_config with `mkctl settings write`; motors off.",
    )
    GPS_STEERS = (
        "gps_steers",
        "the pilot's GPS switch is at {mode}: the NaviCtrl also steers, against the daemon.",
        "The pilot turns the GPS switch to free.",
    )
    EMERGENCY_CLIMBS = (
        "emergency_climbs",
        "with the emergency throttle NotGas {value} the aircraft does not sink when the receiver is lost; it hovers at "
        "about {hover}.",
        "Reduce it: `mkctl settings write emergency_throttle=...`; or correct control.limiter.hover_throttle.",
    )
    EMERGENCY_FALLS = (
        "emergency_falls",
        "with the emergency throttle NotGas {value} for {time} (NotGasZeit) the aircraft falls when the receiver is "
        "lost: it carries {share:.0f} % of the weight.",
        "`mkctl settings write emergency_throttle=...`, {low} to {high}, and a time above zero.",
    )
    RECEIVER_WEAK = (
        "receiver_weak",
        "the pilot's receiver quality is {quality:.0f} %, below {limit:.0f} %.",
        "Switch the transmitter on, check antennas and range; the pilot must be able to take over.",
    )
    BATTERY_LOW = ("battery_low", "the battery is low: {voltage:.1f} V.", "Land and change the battery.")
    CELLS_DOUBTFUL = (
        "cells_doubtful",
        "the battery has {cells} cells, or {more} if nearly empty ({voltage:.1f} V would be {cell:.2f} V a cell); the "
        "FlightCtrl counts {cells}, so its low-battery alarm may come too late.",
        "Measure the battery, and set vehicle.battery_cells in the configuration.",
    )
    CAMERA_UNFIT = (
        "camera_unfit",
        "no camera or source of poses can be flown by: {detail}.",
        "Silent or gone: check its cable and power, and that no other program has opened it. `mkctl watch 'vision/**'` "
        "shows it; docs/cameras.md, docs/positions.md.",
    )
    CAMERA_OPENING = (
        "camera_opening",
        "no camera delivers yet: {detail}.",
        "Wait some seconds, then repeat; `mkctl watch 'vision/**'` shows when images arrive.",
        Status.BUSY,
    )
    SOURCE_UNTRUSTED = (
        "source_untrusted",
        "{name} would be flown by {sources} alone, which the configuration does not trust for it.",
        "Add `{word}` to `trusted_for` of the source, or fly where a camera sees the target; docs/positions.md.",
    )
    CAMERAS_CONTRADICT = (
        "cameras_contradict",
        "cameras see the target in different places; {cameras} contradicts the others.",
        "Compare `vision/*/pose`; correct `mount` of the wrong one (`mkdaemon calibrate mount`), or remove it.",
    )
    HEIGHTS_CONTRADICTED = (
        "heights_contradicted",
        "camera {camera} over {target} measured a climb or descent of {way:.2f} m, the barometer {by:.2f} +- "
        "{sd:.2f} m: heights and distances have an error of {share:+.0f} %.",
        "Measure the print against its target file and calibrate the camera; then restart the daemon.",
    )
    IMAGES_LATE = (
        "images_late",
        "half of the images of camera {camera} are older than {late:.0f} ms after processing; the limit is "
        "{limit:.0f} ms.",
        "Stop other programs on this computer; use a nearer camera, smaller images or a lower rate (docs/cameras.md).",
    )
    CAMERA_TURNED = (
        "camera_turned",
        "the camera sees the opposite of what the boards report when the aircraft tilts (correlation {likeness:.1f}).",
        "Correct `mount` in the camera file (docs/frames.md), or the signs of the boards.",
    )
    STAMPS_OFF = (
        "stamps_off",
        "the images' time stamps have an error of {lag:+.0f} ms, more than {limit:.0f} ms, against the attitude.",
        "If it is constant, set `latency_ms` of the camera to it; else use a source that stamps (docs/cameras.md).",
    )
    DISK_FULL = (
        "disk_full",
        "{free:.0f} MB are free for recordings, less than {limit:.0f} MB.",
        "Free some space; `mkctl preflight` checks again.",
    )

    # procedures on the boards
    BAD_VALUE = ("bad_value", "{detail}.", "`mkctl settings show` lists names and values.")
    FLYING = (
        "flying",
        "{name} is not possible in flight, and control is {phase}.",
        "Return the lease (`mkctl release`), stop the motors, repeat.",
    )
    IN_FLIGHT_NEEDED = (
        "in_flight_needed",
        "{detail}, and {name} takes effect at once.",
        "Land and stop the motors; or, if you accept the effect, repeat with `in_flight` (`--in-flight`).",
    )
    MOTORS_STARTED = (
        "motors_started",
        "the motors started during {name}, or their state is unknown: the procedure may be incomplete.",
        "Land, stop the motors, repeat.",
    )
    LIST_INCOMPLETE = (
        "list_incomplete",
        "{detail}; the board's list may be incomplete.",
        "Repeat the upload, or empty the list: `mkctl waypoints clear`.",
    )
    LIVE_SET_OWED = (
        "live_set_owed",
        "{verb} was interrupted, and parameter set {slot}, active before it, may not be active now; {name} must wait: "
        "{detail}.",
        "Stop the motors: it is restored as soon as the FlightCtrl answers; `mkctl settings recover` shows progress.",
    )
    JOURNAL_UNWRITABLE = (
        "journal_unwritable",
        "the note of the live parameter set, needed if the daemon dies, cannot be written: {detail}.",
        "Make the folder writable, or set vehicle.state_folder in the configuration.",
    )
    CANCELLED = ("cancelled", "{name} was cancelled: {detail}.", "Repeat it; until then a half-written value remains.")
    NO_PROCEDURE = ("no_procedure", "no such procedure is running.", "`mkctl get event/progress` shows the last.")
    PROCEDURE_FAILED = ("procedure_failed", "{name} failed: {detail}.", "Check `mkctl health`, then repeat it.")
    NOT_CLEARED = (
        "not_cleared",
        "the NaviCtrl still holds {count} points after the list was cleared {rounds} times.",
        "Check that no other program uploads; then repeat.",
    )
    POINT_REFUSED = (
        "point_refused",
        "the NaviCtrl refused point {number} of {total} (it answered 0 and still holds {count} points).",
        "Shorten the mission: NaviCtrl 0.24 holds 31 points.",
    )
    NOT_VERIFIED = (
        "not_verified",
        "after {rounds} rounds the NaviCtrl's list still differs at {where}; do not fly it.",
        "Improve the line (`mkctl health`), then upload again; `mkctl waypoints clear` empties the list.",
    )
    LIST_CHANGING = (
        "list_changing",
        "the waypoint list changed while it was read ({before} points, then {after}).",
        "End the other program that uploads, then repeat.",
    )
    TOO_MANY_POINTS = (
        "too_many_points",
        "the mission has {count} points and this board holds {limit}.",
        "Split the mission, or remove points.",
    )
    POINT_NOT_EXPRESSIBLE = (
        "point_not_expressible",
        "point {number}: {detail}.",
        "Change the point; docs/waypoints.md shows what each NaviCtrl release can express.",
    )
    POINT_UNUSUAL = (
        "point_unusual",
        "point {number} {detail}.",
        "Correct the point; or, if it is intended, repeat with `allow_unusual` (`--allow-unusual`).",
    )
    NO_ROUTE = ("no_route", "the NaviCtrl holds no points.", "Upload a mission first: `mkctl waypoints upload FILE`.")
    ROUTE_ON_GROUND = (
        "route_on_ground",
        "a route is started in flight, and {detail}: a NaviCtrl 0.24 flies home with a list activated on the ground.",
        "Take off by hand, then repeat.",
    )
    ROUTE_ACTIVE = (
        "route_active",
        "the list is active already, at point {index} of {count}.",
        "The pilot's GPS switch at coming home flies it; `mkctl waypoints end` ends it.",
    )
    SWITCH_AT_HOME = (
        "switch_at_home",
        "the pilot's GPS switch is at coming home: a changed list would be flown at once, or end in a flight home.",
        "Turn the GPS switch to hold or free; repeat; then turn it to coming home.",
    )
    POSITION_POOR = (
        "position_poor",
        "the NaviCtrl's position is not accurate enough for flight: {detail}.",
        "Start the motors under open sky with a fix, which sets home; over a target fly with `--frame pad`.",
    )
    UNKNOWN_NAVICTRL = (
        "unknown_navictrl",
        "the points of NaviCtrl {release} are not documented.",
        "Nothing was sent; docs/protocol.md lists the releases this version knows.",
    )
    UNKNOWN_REVISION = (
        "unknown_revision",
        "parameter sets of revision {revision} ({size} bytes) are not known for FlightCtrl {release}.",
        "They can only be backed up as raw bytes; nothing was written.",
    )
    REVISION_DIFFERS = (
        "revision_differs",
        "the file has revision {wanted}, the FlightCtrl {present}.",
        "Restore to the firmware of the backup; nothing was written.",
    )
    LENGTH_DIFFERS = (
        "length_differs",
        "the file holds {wanted} bytes for a parameter set and the FlightCtrl sends {present}.",
        "The file is damaged or from another firmware; nothing was written.",
    )
    LIVE_SET_CHANGED = (
        "live_set_changed",
        "the active parameter set {slot} has changed: {where}.",
        "Do not fly; restore the set from a backup and compare.",
    )
    LIVE_SET_UNPROVEN = (
        "live_set_unproven",
        "reading stopped ({cause}), and it is not certain that set {slot} is live again.",
        "Do not fly: the daemon makes it live again as soon as the FlightCtrl answers; repeat on a better line.",
    )
    ACTIVE_SET_MOVED = (
        "active_set_moved",
        "the FlightCtrl reports that set {present} is active; set {wanted} was before.",
        "Select the set on the transmitter, or restore again, before you fly.",
    )
    WRITE_REFUSED = (
        "write_refused",
        "the FlightCtrl refused to store set {slot} (it answered 0).",
        "Stop the motors; check that the set was made for this firmware.",
    )
    MIXER_REFUSED = (
        "mixer_refused",
        "the FlightCtrl refused the mixer: it uses another revision.",
        "Nothing was stored; save its mixer first.",
    )
    MIXER_DIFFERS = (
        "mixer_differs",
        "the FlightCtrl holds another mixer than was sent ({where}).",
        "Do not fly; store the mixer again and compare.",
    )
    MOTOR_CONTROLLER_REFUSED = (
        "motor_controller_refused",
        "motor controller {motor}: {status}.",
        "Check that the motors are off and that the controller is a BL-Ctrl 2.0 or later.",
    )
    MOTOR_CONTROLLER_DIFFERS = (
        "motor_controller_differs",
        "motor controller {motor}: {where}.",
        "Do not fly; set it again and compare.",
    )
    LABELS_INCONSISTENT = (
        "labels_inconsistent",
        "the checksum of the labels differs from the {board}'s ({found:#04x}, not {wanted:#04x}).",
        "Read them again on a better line.",
    )

    # faults of the simulator
    UNKNOWN_FAULT = ("unknown_fault", "there is no fault {name!r}.", "Did you mean {near!r}? All: {known}.")
    UNKNOWN_PARAMETER = (
        "unknown_parameter",
        "fault {name!r} has no parameter {parameter!r}.",
        "Its parameters: {known}.",
    )
    OUT_OF_RANGE = ("out_of_range", "{name} cannot be {value}.", "Give {wanted}.")
    NOT_SIMULATED = (
        "not_simulated",
        "a recorded flight is only flown by a simulator: {detail}.",
        "Start `mkdaemon sim`, then `mkdaemon run --port` with the port that it prints, for the same vehicle.",
    )


TOKENS: Final[Mapping[str, Token]] = {token.value: token for token in Token}
"""Every refusal by its word, as it comes over the bus; another version may know others."""


def refuse(token: Token, **words: Any) -> CommandRejectedError:
    """Make the refusal `token`, its reason and fix filled in with `words`."""
    filled = KnownWords(words)
    return CommandRejectedError(token, token.reason.format_map(filled), token.fix.format_map(filled))
