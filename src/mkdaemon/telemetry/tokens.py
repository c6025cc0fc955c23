"""How commands end, and the stable words by which programs know why one was refused."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class Status(StrEnum):
    """How a command ended."""

    ACCEPTED = "accepted"
    DENIED = "denied"
    BUSY = "busy"
    UNSUPPORTED = "unsupported"
    TIMEOUT = "timeout"
    NOT_OBSERVABLE = "not_observable"
    """Sent, but this board gives no sign by which success could be known."""


class Token(StrEnum):
    """Stable word of a refusal."""

    # the request itself
    MALFORMED = "malformed"
    BAD_FIELD = "bad_field"
    UNKNOWN_MESSAGE = "unknown_message"
    UNKNOWN_VERB = "unknown_verb"
    UNSUPPORTED = "unsupported"
    READ_ONLY = "read_only"
    DISCOVERING = "discovering"
    BUSY = "busy"
    INTERNAL = "internal"

    # the line
    LINK_DOWN = "link_down"
    TIMEOUT = "timeout"
    LINE_BUDGET = "line_budget"
    UPLINK_BUDGET = "uplink_budget"
    NO_SUCH_STREAM = "no_such_stream"
    BOARD_UNREACHABLE = "board_unreachable"
    NO_REPLY = "no_reply"
    RECORDING = "recording"
    NOT_REDIRECTABLE = "not_redirectable"
    MOTORS_NOT_KNOWN_OFF = "motors_not_known_off"
    WRONG_LAYOUT = "wrong_layout"
    RELEASING = "releasing"
    UNCONFIRMED = "unconfirmed"
    BOARD_DEAF = "board_deaf"
    REMEMBERED_ONLY = "remembered_only"
    NOTHING_REMEMBERED = "nothing_remembered"

    # dangers
    NOT_ENABLED = "not_enabled"
    NOT_CONFIRMED = "not_confirmed"
    MOTORS_RUNNING = "motors_running"
    MOTORS_UNKNOWN = "motors_unknown"
    BOARD_UNPROVEN = "board_unproven"
    NEVER = "never"
    DEAF_TOO_LONG = "deaf_too_long"

    # authority
    NOT_LEASED = "not_leased"
    FLYING_STOP = "flying_stop"
    NOTHING_FLOWN = "nothing_flown"
    LEASE_HELD = "lease_held"
    SLOW_PATH = "slow_path"
    WRONG_EPOCH = "wrong_epoch"
    NOT_HOLDER = "not_holder"
    STALE_SEQUENCE = "stale_sequence"
    SEQUENCE_JUMP = "sequence_jump"
    NO_GUIDANCE = "no_guidance"
    NO_ESTIMATE = "no_estimate"
    NOT_READY = "not_ready"
    NO_FRAME = "no_frame"
    GATE_SHUT = "gate_shut"
    GATE_CONSTANT = "gate_constant"
    GATE_SWITCHES_ALTITUDE = "gate_switches_altitude"
    NO_CONTROL = "no_control"
    GUARD_DEAD = "guard_dead"

    # before a flight against a target
    LOOP_UNSTABLE = "loop_unstable"
    GAIN_ON_POTI = "gain_on_poti"
    GAIN_ZERO = "gain_zero"
    LINK_POOR = "link_poor"
    HEIGHT_CONTROL = "height_control"
    GPS_STEERS = "gps_steers"
    EMERGENCY_CLIMBS = "emergency_climbs"
    EMERGENCY_FALLS = "emergency_falls"
    RECEIVER_WEAK = "receiver_weak"
    BATTERY_LOW = "battery_low"
    CAMERA_UNFIT = "camera_unfit"
    CAMERAS_CONTRADICT = "cameras_contradict"
    IMAGES_LATE = "images_late"
    CAMERA_TURNED = "camera_turned"
    STAMPS_OFF = "stamps_off"
    DISK_FULL = "disk_full"

    # procedures on the boards
    BAD_VALUE = "bad_value"
    FLYING = "flying"
    IN_FLIGHT_NEEDED = "in_flight_needed"
    MOTORS_STARTED = "motors_started"
    LIST_INCOMPLETE = "list_incomplete"
    LIVE_SET_OWED = "live_set_owed"
    JOURNAL_UNWRITABLE = "journal_unwritable"
    CANCELLED = "cancelled"
    NO_PROCEDURE = "no_procedure"
    PROCEDURE_FAILED = "procedure_failed"
    NOT_CLEARED = "not_cleared"
    POINT_REFUSED = "point_refused"
    NOT_VERIFIED = "not_verified"
    LIST_CHANGING = "list_changing"
    TOO_MANY_POINTS = "too_many_points"
    POINT_NOT_EXPRESSIBLE = "point_not_expressible"
    POINT_UNUSUAL = "point_unusual"
    NO_ROUTE = "no_route"
    ROUTE_ON_GROUND = "route_on_ground"
    ROUTE_ACTIVE = "route_active"
    SWITCH_AT_HOME = "switch_at_home"
    POSITION_POOR = "position_poor"
    PILOTS_SWITCH = "pilots_switch"
    UNKNOWN_NAVICTRL = "unknown_navictrl"
    UNKNOWN_REVISION = "unknown_revision"
    REVISION_DIFFERS = "revision_differs"
    LENGTH_DIFFERS = "length_differs"
    LIVE_SET_CHANGED = "live_set_changed"
    LIVE_SET_UNPROVEN = "live_set_unproven"
    ACTIVE_SET_MOVED = "active_set_moved"
    WRITE_REFUSED = "write_refused"
    MIXER_REFUSED = "mixer_refused"
    MIXER_DIFFERS = "mixer_differs"
    MOTOR_CONTROLLER_REFUSED = "motor_controller_refused"
    MOTOR_CONTROLLER_DIFFERS = "motor_controller_differs"
    LABELS_INCONSISTENT = "labels_inconsistent"

    # faults of the simulator
    UNKNOWN_FAULT = "unknown_fault"
    UNKNOWN_PARAMETER = "unknown_parameter"
    OUT_OF_RANGE = "out_of_range"
    NOT_SIMULATED = "not_simulated"


class Refusal(NamedTuple):
    """One way to be refused; reason and fix may name `{words}` that the refusal fills in."""

    status: Status
    reason: str
    fix: str
