"""What is said about a vehicle beside its picture: one line for each thing an engineer asks.

A value that is not known is said to be not known; one that is older than its key allows looks stale, with its age.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

from mkdaemon.client.summary import WEAK_CELL
from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlStatus, Phase
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkState
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.state import Attitude, Battery, Flight, Gps, Pilot
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import EyeState, VisionStats
from mkdaemon.view.page.known import Knowledge, Known

UNKNOWN: Final = "not known"


@dataclass(frozen=True, slots=True)
class Line:
    """One thing said.

    Attributes:
        id: stable word.
        name: what it is about.
        text: what is said.
        tone: `ok`, `note`, `warn`, `bad`, or `unknown`.
        age: of what it stands on [s]; None where nothing is known.
        is_stale: that is older than its key allows.
    """

    id: str
    name: str
    text: str
    tone: str = "note"
    age: float | None = None
    is_stale: bool = False

    def as_map(self) -> dict[str, Any]:
        """For the page."""
        return asdict(self)


def lines_of(known: Knowledge) -> list[Line]:
    """Everything said about a vehicle, in order."""
    fixed = [_line(known, *row) for row in _ROWS]
    return [*fixed, *_eyes(known)]


def verdict_of(known: Knowledge, *, is_here: bool, is_played: bool) -> tuple[str, str]:
    """The vehicle in one sentence, and its tone.

    Args:
        known: its last values.
        is_here: its daemon, or the player of its recording, is alive.
        is_played: it is a recording.
    """
    status, health = known.fresh("control/status", ControlStatus), known.fresh("health", VehicleHealth)
    flight, link = known.fresh("state/flight", Flight), known.fresh("link/state", LinkState)
    if not is_here:
        return ("The recording is no longer played" if is_played else "No daemon: nothing is known of now"), "bad"
    if status is None and health is None:
        return "Nothing fresh from the daemon", "bad"
    if health is not None and not health.is_alive:
        return f"The aircraft is silent: {health.reason}", "bad"
    if flight is not None and flight.emergency_landing:
        return "EMERGENCY LANDING: receiver lost", "bad"
    if status is not None and status.pilots_throttle is not None:
        return f"The pilot {status.hands}", "bad"
    if status is not None and status.trouble:
        return status.trouble, "bad"
    if status is None or status.phase is Phase.FREE:
        flies = {True: "The pilot flies", False: "On the ground", None: "The pilot has it"}
        words = flies[None if flight is None else flight.is_flying]
        if link is None or link.condition.is_usable:
            return words, "ok"
        return f"{words}; {_LINK_WORDS[link.condition]}", "warn"
    return _phase(status), status.phase.tone


_LINK_WORDS: Final = {
    LinkCondition.UP: "link up",
    LinkCondition.DEGRADED: "link degraded",
    LinkCondition.ONE_WAY: "the board does not hear us",
    LinkCondition.MUTE: "the board is mute",
    LinkCondition.GARBAGE: "only garbage arrives",
    LinkCondition.DOWN: "the port cannot be used",
    LinkCondition.ABSENT: "there is no port",
    LinkCondition.CLOSED: "the port is closed",
}


def _phase(status: ControlStatus) -> str:
    words = status.phase.words.format(holder=_holder(status))
    manoeuvre = f": {_manoeuvre_words(status)}" if status.phase is Phase.FLYING and status.manoeuvre else ""
    return words[:1].upper() + words[1:] + manoeuvre


def _holder(status: ControlStatus) -> str:
    return "nobody" if status.lease is None else status.lease.holder


def _manoeuvre_words(status: ControlStatus) -> str:
    if status.manoeuvre is None:
        return f"ended: {status.outcome.replace('_', ' ')}" if status.outcome else "none"
    stage = f", {status.stage}" if status.stage else ""
    return f"{status.manoeuvre}{stage}{', done' if status.is_done and 'done' not in stage else ''}"


# -- lines ------------------------------------------------------------------------------------------------------------

Words = tuple[str, str]
"""Text and tone."""


def _authority(status: ControlStatus, known: Knowledge) -> Words:
    words = status.phase.words.format(holder=_holder(status))
    words = words if status.reason in ("", words) else f"{words}; {status.reason}"
    layout = "" if status.external_control else "; external control is not possible"
    return words + layout, status.phase.tone


def _manoeuvre(status: ControlStatus, known: Knowledge) -> Words:
    return _manoeuvre_words(status), "ok" if status.is_done else "note"


def _hands(status: ControlStatus, known: Knowledge) -> Words:
    if not status.hands:
        return UNKNOWN, "unknown"
    return f"the pilot {status.hands}", "note" if status.pilots_throttle is None else "bad"


def _flight(flight: Flight, known: Knowledge) -> Words:
    place = {True: "in the air", False: "on the ground", None: "in the air or not: not known"}[flight.is_flying]
    motors = {True: "motors run", False: "motors stand", None: "motors not known"}[flight.motors_running]
    words = [place, motors]
    if flight.flying_time is not None:
        words.append(f"flew {flight.flying_time:.0f} s")
    alarms = [name.replace("_", " ") for name in _ALARMS if getattr(flight, name)]
    if flight.error_code:
        alarms.append(flight.error)
    return ", ".join(words + [alarm.upper() for alarm in alarms]), "bad" if alarms else "note"


_ALARMS: Final = ("emergency_landing", "battery_low", "rc_failsafe", "range_limit", "serial_link_lost")


def _battery(battery: Battery, known: Knowledge) -> Words:
    health = known.fresh("health", VehicleHealth)
    cells = None if health is None else health.battery_cells
    words = [f"{battery.voltage:.1f} V"]
    words += [] if not cells else [f"{battery.voltage / cells:.2f} V a cell"]
    words += [] if battery.current is None else [f"{battery.current:.1f} A"]
    words += [] if battery.used_mah is None else [f"{battery.used_mah:.0f} mAh used"]
    if battery.is_low:
        return ", ".join([*words, "LOW"]), "bad"
    is_weak = bool(cells) and battery.voltage / (cells or 1) < WEAK_CELL
    return ", ".join(words), "warn" if is_weak else "ok"


def _position(estimate: ControlEstimate, known: Knowledge) -> Words:
    x, y, z = estimate.position
    sd = 100 * max(estimate.position_sd)
    words = f"x {x:+.2f}  y {y:+.2f}  z {z:.2f} m over {estimate.target}, ± {sd:.1f} cm"
    if estimate.contradicting:
        return f"{words}; {', '.join(estimate.contradicting)} CONTRADICTS", "bad"
    return words, "ok" if estimate.image_age < 0.5 else "warn"


def _error(error: ControlError, known: Knowledge) -> Words:
    x, y, z = error.error_pad
    yaw = "" if error.error_yaw is None else f", heading {math.degrees(error.error_yaw):+.0f}°"
    return f"{100 * math.hypot(x, y):.0f} cm level, {100 * z:+.0f} cm height{yaw}", "note"


def _attitude(attitude: Attitude, known: Knowledge) -> Words:
    roll, pitch, yaw = (math.degrees(angle) for angle in (attitude.roll, attitude.pitch, attitude.yaw))
    return f"roll {roll:+.1f}°  pitch {pitch:+.1f}°  heading {(90 - yaw) % 360:.0f}°", "note"


def _link(link: LinkState, known: Knowledge) -> Words:
    tone = "ok" if link.condition is LinkCondition.UP else "warn" if link.condition.hears_board else "bad"
    return f"{_LINK_WORDS[link.condition]}; {link.reason}", tone


def _latency(health: LinkHealth, known: Knowledge) -> Words:
    path = health.confirm if health.confirm.p50_ms is not None else health.echo
    if path.p50_ms is None or path.p99_ms is None:
        return "no answer measured yet", "unknown"
    words = f"p50 {path.p50_ms:.0f} ms, p99 {path.p99_ms:.0f} ms, {path.loss_percent:.1f} % lost"
    return words, "ok" if path.loss_percent < 2.0 else "warn"


def _pilot(pilot: Pilot, known: Knowledge) -> Words:
    words = f"{100 * pilot.rc_quality:.0f} %"
    return (words, "ok") if pilot.has_signal else (f"{words}, NO SIGNAL", "bad")


def _gps(gps: Gps, known: Knowledge) -> Words:
    satellites = "not known how many" if gps.satellites is None else f"{gps.satellites}"
    return f"{satellites} satellites, position {gps.fix}", "ok" if gps.is_usable else "note"


def _recording(status: RecordStatus, known: Knowledge) -> Words:
    lost = f", {status.lost} LOST" if status.lost else ""
    if status.state is RecorderState.RECORDING:
        return f"{status.entries} entries{lost}", "bad" if status.lost else "ok"
    return f"NOT RECORDING ({status.state}): {status.reason}{lost}", "warn"


_Row = tuple[str, str, str, type[Any], Callable[[Any, Knowledge], Words]]
_ROWS: Final[tuple[_Row, ...]] = (
    ("authority", "who flies", "control/status", ControlStatus, _authority),
    ("manoeuvre", "manoeuvre", "control/status", ControlStatus, _manoeuvre),
    ("hands", "pilot's hands", "control/status", ControlStatus, _hands),
    ("flight", "flight", "state/flight", Flight, _flight),
    ("battery", "battery", "state/battery", Battery, _battery),
    ("position", "position", "control/estimate", ControlEstimate, _position),
    ("error", "from the goal", "control/error", ControlError, _error),
    ("attitude", "attitude", "state/attitude", Attitude, _attitude),
    ("link", "link", "link/state", LinkState, _link),
    ("latency", "latency", "link/health", LinkHealth, _latency),
    ("receiver", "receiver", "state/pilot", Pilot, _pilot),
    ("gps", "GPS", "state/gps", Gps, _gps),
    ("recording", "recording", "record/status", RecordStatus, _recording),
)


def _line(
    known: Knowledge, word: str, name: str, key: str, kind: type[Any], make: Callable[[Any, Knowledge], Words]
) -> Line:
    found = known.last(key, kind)
    if found is None:
        return _motors(known) if word == "flight" else Line(word, name, UNKNOWN, "unknown")
    text, tone = make(found.value, known)
    return Line(word, name, text, tone, known.age(found), known.is_stale(key, found))


def _motors(known: Knowledge) -> Line:
    """What is known of the flight where no NaviCtrl tells: whether the motors run."""
    found = known.last("health", VehicleHealth)
    if found is None or found.value.motors_running is None:
        return Line("flight", "flight", UNKNOWN, "unknown")
    words = f"motors {'run' if found.value.motors_running else 'stand'}, in the air or not: {UNKNOWN}"
    return Line("flight", "flight", words, "note", known.age(found), known.is_stale("health", found))


def _eyes(known: Knowledge) -> Iterator[Line]:
    """A line for each camera; one where there is none."""
    cameras = known.cameras()
    if not cameras:
        yield Line("eyes", "eyes", UNKNOWN, "unknown")
    for name in cameras:
        key = f"vision/{name}/stats"
        found: Known[VisionStats] | None = known.last(key, VisionStats)
        if found is None:
            yield Line(f"eye-{name}", f"camera {name}", UNKNOWN, "unknown")
            continue
        text, tone = _eye(found.value)
        yield Line(f"eye-{name}", f"camera {name}", text, tone, known.age(found), known.is_stale(key, found))


def _eye(stats: VisionStats) -> Words:
    if stats.state is not EyeState.OK:
        return f"{stats.state}: {stats.reason}", "bad"
    words = [f"{stats.fps:.0f} Hz, {100 * stats.posed:.0f} % gave a pose, {stats.latency_p50_ms:.0f} ms"]
    words += stats.alarms.values()
    return "; ".join(words), "warn" if stats.alarms or stats.posed < 0.5 else "ok"
