"""What is said about a vehicle beside its picture: one line for each thing an engineer asks.

A value that is not known is said to be not known; one that is older than its key allows looks stale, with its age.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final

from mkdaemon.client.summary import WEAK_CELL
from mkdaemon.client.verdict import LINK_WORDS, STANDS_ON, holder_of, manoeuvre_words
from mkdaemon.client.verdict import verdict_of as worst_of
from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlStatus
from mkdaemon.telemetry.link import FATES, LinkCondition, LinkHealth, LinkState
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
    if not is_here:
        words = "The recording is no longer played" if is_played else "No daemon: nothing is known of now"
        return words, "bad"
    return worst_of(*(known.fresh(suffix, kind) for suffix, kind in STANDS_ON.items()))


# -- lines ------------------------------------------------------------------------------------------------------------

Words = tuple[str, str]
"""Text and tone."""


def _authority(status: ControlStatus, known: Knowledge) -> Words:
    words = status.phase.words.format(holder=holder_of(status))
    words = words if status.reason in ("", words) else f"{words}; {status.reason}"
    layout = "" if status.external_control else "; external control is not possible"
    return words + layout, status.phase.tone


def _manoeuvre(status: ControlStatus, known: Knowledge) -> Words:
    return manoeuvre_words(status), "ok" if status.is_done else "note"


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
    return f"{LINK_WORDS[link.condition]}; {link.reason}", tone


def _latency(health: LinkHealth, known: Knowledge) -> Words:
    path = health.confirm if health.confirm.p50_ms is not None else health.echo
    if path.p50_ms is None or path.p99_ms is None:
        return "no answer measured yet", "unknown"
    return f"p50 {path.p50_ms:.0f} ms, p99 {path.p99_ms:.0f} ms", "ok"


def _fates(title: str) -> Callable[[LinkHealth, Knowledge], Words]:
    """What became of everything of one kind that was sent. How much loss is too much is the daemon's verdict alone."""

    def words(health: LinkHealth, known: Knowledge) -> Words:
        fates = health.fates.get(title)
        if fates is None:
            return "none sent", "note"
        is_well = health.state.condition is LinkCondition.UP or not fates.unanswered
        return fates.words, "ok" if is_well else "warn"

    return words


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
    *((name, title, "link/health", LinkHealth, _fates(title)) for name, title in FATES.items()),
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
