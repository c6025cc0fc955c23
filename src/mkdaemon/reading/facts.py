"""The one table that turns values into facts: what is said of each, in words, how good it is, and its number.

A fact without a value says that it is not known. What a screen shows is a choice of these rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from typing import Any, Final, NamedTuple, TypeVar

from mkdaemon.bus.keys import fresh_for
from mkdaemon.reading.known import Knowledge, Known
from mkdaemon.spelling import on_one_line
from mkdaemon.telemetry.control import NEVER_TAKEN, ControlError, ControlEstimate, ControlStatus, Phase
from mkdaemon.telemetry.link import FATES, LinkHealth, LinkState
from mkdaemon.telemetry.record import RecordStatus
from mkdaemon.telemetry.state import Altitude, Attitude, Battery, Flight, Gps, Pilot, Position, Velocity
from mkdaemon.telemetry.tone import Tone
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import EyeState, PoseRefused, Tags, VisionPose, VisionStats

_Value = TypeVar("_Value")
UNKNOWN: Final = "not known"
WEAK_CELL: Final = 3.5
"""A lithium cell below this has less than a tenth left, less under load [V]."""
EMPTY_CELL: Final = 3.0
"""A lithium cell below this is damaged [V]."""
SIGHT: Final = fresh_for("vision/<camera>/pose") or 0.0
"""A target whose last pose is older is not in sight [s]."""
DEAD_RECKONING: Final = fresh_for("control/estimate") or 0.0
"""An estimate whose newest image is older is a calculation [s]."""


class Fact(NamedTuple):
    """What is said of one thing.

    Attributes:
        id: stable word.
        name: what it is about.
        text: what is said, on one line; what others wrote is spelled.
        tone: how good it is.
        number: the number that it stands on; None for none.
        unit: of the number.
        key: key of the value; empty for none.
        age: of the value [s]; None where there is none.
        is_stale: the value is older than its key allows.
    """

    id: str
    name: str
    text: str
    tone: Tone = Tone.NOTE
    number: float | None = None
    unit: str = ""
    key: str = ""
    age: float | None = None
    is_stale: bool = False

    @property
    def aged(self) -> str:
        """The text; that of a stale value begins with `STALE` and its age."""
        return f"STALE {age_words(self.age)}: {self.text}" if self.is_stale and self.age is not None else self.text

    def as_map(self) -> dict[str, Any]:
        """For JSON."""
        return self._asdict()


class Wording(NamedTuple):
    """What a value says.

    Attributes:
        text: in words.
        tone: how good it is.
        number: behind it; None for none.
        unit: of the number.
    """

    text: str
    tone: Tone = Tone.NOTE
    number: float | None = None
    unit: str = ""


def because(words: str, reason: str) -> str:
    """Words and their reason, where there is one."""
    return f"{words}: {reason}" if reason else words


def age_words(seconds: float) -> str:
    """A length of time, short [s]."""
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000.0 else f"{seconds / 3600:.0f} h"


# -- control ----------------------------------------------------------------------------------------------------------


def holder_of(status: ControlStatus) -> str:
    """Holder of the lease."""
    return "no client" if status.lease is None else status.lease.holder


def manoeuvre_words(status: ControlStatus) -> str:
    """What is flown, and how far it is."""
    if status.manoeuvre is None:
        return f"ended: {status.outcome.replace('_', ' ')}" if status.outcome else "none"
    stage = f", {status.stage}" if status.stage else ""
    return f"{status.manoeuvre}{stage}{', done' if status.is_done and 'done' not in stage else ''}"


def phase_words(status: ControlStatus) -> str:
    """The holder and the manoeuvre, as a sentence."""
    words = status.phase.words.format(holder=holder_of(status))
    manoeuvre = f": {manoeuvre_words(status)}" if status.phase is Phase.FLYING and status.manoeuvre else ""
    return words[:1].upper() + words[1:] + manoeuvre


def _control(status: ControlStatus, known: Knowledge) -> Wording:
    words = status.phase.words.format(holder=holder_of(status))
    words = words if status.reason in ("", words, NEVER_TAKEN) else f"{words}; {status.reason}"
    layout = status.external_control or "not possible"
    return Wording(f"{words}; external control {layout}", Tone.BAD if status.trouble else status.phase.tone)


def _manoeuvre(status: ControlStatus, known: Knowledge) -> Wording:
    return Wording(manoeuvre_words(status), Tone.OK if status.is_done else Tone.NOTE)


def _hands(status: ControlStatus, known: Knowledge) -> Wording:
    if not status.hands:
        return Wording(UNKNOWN, Tone.UNKNOWN)
    return Wording(f"the pilot {status.hands}", Tone.NOTE if status.pilots_throttle is None else Tone.BAD)


# -- the aircraft -----------------------------------------------------------------------------------------------------

MOTORS: Final = {True: "motors on", False: "motors off", None: "motors unknown"}
_PLACES: Final = {True: "in the air", False: "on the ground", None: "in the air: unknown"}
FLIGHT_ALARMS: Final = {
    "emergency_landing": Tone.BAD,
    "battery_low": Tone.BAD,
    "rc_failsafe": Tone.BAD,
    "range_limit": Tone.WARN,
    "serial_link_lost": Tone.WARN,
}
"""Flags of `state/flight` that are alarms."""


def flight_alarms(flight: Flight) -> Iterator[tuple[str, Tone]]:
    """What the boards warn of, in words."""
    for name, tone in FLIGHT_ALARMS.items():
        if getattr(flight, name):
            yield name.replace("_", " ").upper(), tone
    if flight.error_code:
        yield f"ERROR: {flight.error}", Tone.BAD


def worst_of(tones: Iterator[Tone] | list[Tone], otherwise: Tone) -> Tone:
    """The worst tone; one for none."""
    return max(tones, key=RANKS.index, default=otherwise)


RANKS: Final = (Tone.OK, Tone.NOTE, Tone.UNKNOWN, Tone.WARN, Tone.BAD)
"""Tones, the worst last."""


def _vehicle(health: VehicleHealth, known: Knowledge) -> Wording:
    words = ["alive" if health.is_alive else f"NOT ALIVE: {health.reason}", MOTORS[health.motors_running]]
    words += [f"ERROR: {health.error}"] if health.error else []
    words += [f"READ ONLY: {health.read_only}"] if health.read_only else []
    words += [health.note] if health.note else []
    bad = not health.is_alive or bool(health.error)
    return Wording("; ".join(words), Tone.BAD if bad else Tone.WARN if health.read_only else Tone.OK)


def _firmware(health: VehicleHealth, known: Knowledge) -> Wording:
    words = ", ".join(f"{board} {release}" for board, release in health.firmware.items())
    return Wording(words or UNKNOWN, Tone.NOTE if words else Tone.UNKNOWN)


def _flight(flight: Flight, known: Knowledge) -> Wording:
    alarms = list(flight_alarms(flight))
    words = [words for words, _ in alarms]
    words += [_PLACES[flight.is_flying], MOTORS[flight.motors_running], f"GPS {flight.gps_mode}"]
    words += [] if flight.flying_time is None else [f"flew {flight.flying_time:.0f} s"]
    return Wording(", ".join(words), worst_of([tone for _, tone in alarms], Tone.NOTE))


def _motors(health: VehicleHealth, known: Knowledge) -> Wording:
    """What is known of the flight without a NaviCtrl: whether the motors run."""
    if health.motors_running is None:
        return Wording(UNKNOWN, Tone.UNKNOWN)
    return Wording(f"{_PLACES[None]}, {MOTORS[health.motors_running]}")


def _attitude(attitude: Attitude, known: Knowledge) -> Wording:
    roll, pitch, yaw = (math.degrees(angle) for angle in (attitude.roll, attitude.pitch, attitude.yaw))
    return Wording(f"roll {roll:+.1f}°, pitch {pitch:+.1f}°, heading {(90 - yaw) % 360:03.0f}°")


def _velocity(velocity: Velocity, known: Knowledge) -> Wording:
    words = f"{velocity.ground_speed:.1f} m/s over ground, {velocity.climb_rate:+.1f} m/s up"
    return Wording(words, Tone.NOTE, velocity.ground_speed, "m/s")


def _place(position: Position, known: Knowledge) -> Wording:
    height, away = position.altitude_above_start, position.home_distance
    words = [f"{position.latitude_deg:.7f}, {position.longitude_deg:.7f}"]
    words.append("height not known" if height is None else f"{height:.1f} m above start")
    words += [] if away is None else [f"{away:.1f} m from home"]
    return Wording(", ".join(words), Tone.NOTE, away, "m")


def cell_voltage(battery: Battery, known: Knowledge) -> float | None:
    """Voltage of a cell [V]; None where their number is not known."""
    health = known.last("health", VehicleHealth)
    cells = None if health is None else health.value.battery_cells
    return battery.voltage / cells if cells else None


def battery_alarm(battery: Battery, known: Knowledge) -> tuple[str, Tone] | None:
    """What is wrong with a battery; None for nothing."""
    each = cell_voltage(battery, known)
    cell = "" if each is None else f", {each:.2f} V a cell"
    if each is not None and each < EMPTY_CELL:
        return f"BATTERY EMPTY: {battery.voltage:.1f} V{cell}", Tone.BAD
    if battery.is_low:
        return f"BATTERY LOW: {battery.voltage:.1f} V{cell}", Tone.BAD
    if each is not None and each < WEAK_CELL:
        return f"BATTERY NEARLY EMPTY: {battery.voltage:.1f} V{cell}", Tone.WARN
    return None


def _battery(battery: Battery, known: Knowledge) -> Wording:
    each, alarm = cell_voltage(battery, known), battery_alarm(battery, known)
    words = [] if alarm is None else [alarm[0].partition(":")[0].removeprefix("BATTERY ")]
    words.append(f"{battery.voltage:.1f} V")
    words += [] if each is None else [f"{each:.2f} V a cell"]
    words += [] if battery.current is None else [f"{battery.current:.1f} A"]
    words += [] if battery.used_mah is None else [f"{battery.used_mah:.0f} mAh"]
    return Wording(", ".join(words), Tone.OK if alarm is None else alarm[1], battery.voltage, "V")


def _gps(gps: Gps, known: Knowledge) -> Wording:
    if gps.satellites is None and gps.fix == "none":
        return Wording("nothing comes from the receiver", Tone.NOTE)
    count = "?" if gps.satellites is None else f"{gps.satellites}"
    words = f"{count} satellites, position {gps.fix}, {'usable' if gps.is_usable else 'NOT usable'}"
    return Wording(words, Tone.OK if gps.is_usable else Tone.NOTE)


def _receiver(pilot: Pilot, known: Knowledge) -> Wording:
    quality = 100 * pilot.rc_quality
    words = f"{quality:.0f} %{'' if pilot.has_signal else ', NO SIGNAL'}"
    return Wording(words, Tone.OK if pilot.has_signal else Tone.BAD, quality, "%")


# -- where it is ------------------------------------------------------------------------------------------------------


def _estimate(estimate: ControlEstimate, known: Knowledge) -> Wording:
    x, y, z = estimate.position
    words = f"x {x:+.2f} y {y:+.2f} z {z:.2f} m over {estimate.target}, ± {100 * max(estimate.position_sd):.1f} cm"
    if estimate.contradicting:
        return Wording(f"{words}; {', '.join(estimate.contradicting)} CONTRADICTS", Tone.BAD)
    if estimate.image_age > DEAD_RECKONING:
        return Wording(f"{words}; no image for {age_words(estimate.image_age)}", Tone.WARN)
    return Wording(words, Tone.OK)


def dead_reckoning(known: Knowledge) -> float | None:
    """Age of the newest image [s] while the estimate is a calculation; None while it is not."""
    found = known.last("control/estimate", ControlEstimate)
    if found is None:
        return None
    is_seen = not known.is_over(found.at + DEAD_RECKONING - found.value.image_age)
    return None if is_seen else found.value.image_age + known.age(found)


def _error(error: ControlError, known: Knowledge) -> Wording:
    if (age := dead_reckoning(known)) is not None:
        return Wording(f"{UNKNOWN}: no image for {age_words(age)}", Tone.UNKNOWN)
    x, y, z = error.error_pad
    level = 100 * math.hypot(x, y)
    yaw = "" if error.error_yaw is None else f", heading {math.degrees(error.error_yaw):+.0f}°"
    return Wording(f"{level:.0f} cm level, {100 * z:+.0f} cm height{yaw}", Tone.NOTE, level, "cm")


def _height(known: Knowledge) -> _Found:
    """Over the target while an image shows it, else by the barometer."""
    estimate, pose = known.last("control/estimate", ControlEstimate), newest_pose(known)
    if estimate is not None and not known.is_stale(estimate) and dead_reckoning(known) is None:
        return estimate, _over(estimate.value.position[2], estimate.value.target)
    if pose is not None and not known.is_stale(pose):
        return pose, _over(pose.value.position_target[2], pose.value.target)
    barometer = known.last("state/altitude", Altitude)
    return None if barometer is None else (barometer, _over(barometer.value.above_start, "start"))


def _over(height: float, place: str) -> Wording:
    return Wording(f"{height:.2f} m over {place}", Tone.NOTE, height, "m")


def newest_pose(known: Knowledge) -> Known[VisionPose] | None:
    """The newest pose of any camera."""
    return known.of_kind(VisionPose)


def pose_age(known: Knowledge) -> float | None:
    """Age of the newest pose of a target [s]; None where there was none."""
    status, pose = known.last("control/status", ControlStatus), newest_pose(known)
    ages = [] if pose is None else [known.age(pose)]
    if status is not None and status.value.pose_age is not None:
        ages.append(status.value.pose_age + known.age(status))
    return min(ages, default=None)


def _pose(known: Knowledge) -> _Found:
    """How old the newest pose is."""
    age, pose = pose_age(known), newest_pose(known)
    found: Known[Any] | None = pose or known.last("control/status", ControlStatus)
    if age is None or found is None:
        return None
    target = "" if pose is None else f" of {pose.value.target}"
    return found, Wording(f"{age_words(age)}{target}", Tone.OK if age <= SIGHT else Tone.NOTE, age, "s")


# -- the line ---------------------------------------------------------------------------------------------------------


def _link(link: LinkState, known: Knowledge) -> Wording:
    return Wording(because(link.condition.words, link.reason), link.condition.tone)


def _port(link: LinkState, known: Knowledge) -> Wording:
    return Wording(f"{link.port}, {link.baud} baud")


def _latency(health: LinkHealth, known: Knowledge) -> Wording:
    path = health.confirm if health.confirm.p50_ms is not None else health.echo
    if path.p50_ms is None or path.p99_ms is None:
        return Wording("no answer measured yet", Tone.UNKNOWN)
    return Wording(f"p50 {path.p50_ms:.0f} ms, p99 {path.p99_ms:.0f} ms", Tone.OK, path.p50_ms, "ms")


def _streams(health: LinkHealth, known: Knowledge) -> Wording:
    late = [kind.key for kind in health.kinds if kind.is_stale]
    return Wording(f"LATE: {', '.join(late)}" if late else "on time", Tone.WARN if late else Tone.OK)


def _fates(title: str) -> Callable[[LinkHealth, Knowledge], Wording]:
    """What became of everything of one kind that was sent. How much loss is too much is the daemon's verdict alone."""

    def words(health: LinkHealth, known: Knowledge) -> Wording:
        fates = health.fates.get(title)
        if fates is None:
            return Wording("none sent")
        is_well = health.state.condition.tone is Tone.OK or not fates.unanswered
        return Wording(fates.words, Tone.OK if is_well else Tone.WARN)

    return words


# -- cameras and recorder ---------------------------------------------------------------------------------------------


def _recording(status: RecordStatus, known: Knowledge) -> Wording:
    lost = f", {status.lost} LOST" if status.lost else ""
    if status.state.tone is Tone.OK:
        words = f"{status.entries} entries, {status.total_bytes / 1e6:.0f} MB{lost}"
        return Wording(words, Tone.WARN if status.lost else Tone.OK)
    return Wording(because(status.state.words, status.reason) + lost, status.state.tone)


def _eye(stats: VisionStats, known: Knowledge) -> Wording:
    if stats.state is not EyeState.OK:
        return Wording(because(stats.state.words.upper(), stats.reason), stats.state.tone)
    seen, used = ("images", "posed") if stats.trusted_for is None else ("reports", "used")
    words = [f"{stats.fps:.0f} {seen}/s, {100 * stats.posed:.0f} % {used}, {stats.latency_p50_ms:.0f} ms"]
    words += [f"{sum(stats.refused.values())} refused"] if stats.trusted_for is not None and stats.refused else []
    words += [f"{alarm.replace('_', ' ').upper()}: {text}" for alarm, text in stats.alarms.items()]
    return Wording("; ".join(words), Tone.WARN if stats.alarms else Tone.OK, stats.fps, "Hz")


def _sight(known: Knowledge, camera: str) -> _Found:
    """Image, tag and pose apart: one can be there without the next."""
    tags = known.last(f"vision/{camera}/tags", Tags)
    pose = known.last(f"vision/{camera}/pose", VisionPose)
    refused = known.last(f"vision/{camera}/refused", PoseRefused)
    found: list[Known[Any]] = [one for one in (tags, pose, refused) if one is not None]
    if not found:
        return None
    image = max(found, key=lambda one: one.at)
    words = [f"image {age_words(known.age(image))}"]
    if tags is not None and not known.is_stale(tags):
        ids = ", ".join(f"{tag.id}" for tag in tags.value.tags)
        words.append(f"tag {ids} decoded" if ids else "no tag decoded")
    if refused is not None and not known.is_stale(refused) and (pose is None or refused.at > pose.at):
        words.append(f"pose of {refused.value.target} refused {refused.value.refusal}")
    is_posed = pose is not None and not known.is_stale(pose)
    if pose is not None and is_posed:
        x, y, z = pose.value.position_target
        words.append(f"pose {age_words(known.age(pose))}: {pose.value.target} ({x:+.2f}, {y:+.2f}, {z:.2f}) m")
    elif pose is not None:
        words.append(f"{pose.value.target} NOT SEEN for {age_words(known.age(pose))}")
    return image, Wording(", ".join(words), Tone.OK if is_posed else Tone.NOTE)


# -- the table --------------------------------------------------------------------------------------------------------

_Found = tuple[Known[Any], Wording] | None
"""The value that a row stands on, and what it says; None where there is none."""


class FactRow(NamedTuple):
    """A row of the table.

    Attributes:
        id: stable word.
        name: what it is about.
        look: at the value that it stands on.
    """

    id: str
    name: str
    look: Callable[[Knowledge], _Found]

    def look_at(self, known: Knowledge) -> tuple[Fact, Known[Any] | None]:
        """The fact without its age, and the value whose age it is. A stale value is never good."""
        found, name = self.look(known), on_one_line(self.name)
        if found is None:
            return Fact(self.id, name, UNKNOWN, Tone.UNKNOWN), None
        value, words = found
        is_stale = known.is_stale(value)
        tone = Tone.UNKNOWN if is_stale and not words.tone.is_wrong else words.tone
        number = (words.number, words.unit, value.key, None, is_stale)
        return Fact(self.id, name, on_one_line(words.text), tone, *number), value


def _last(key: str, kind: type[_Value], words: Callable[[_Value, Knowledge], Wording]) -> Callable[[Knowledge], _Found]:
    """A row that stands on the last value of one key."""

    def look(known: Knowledge) -> _Found:
        found = known.last(key, kind)
        return None if found is None else (found, words(found.value, known))

    return look


def _line(words: Callable[[LinkState, Knowledge], Wording]) -> Callable[[Knowledge], _Found]:
    """A row that stands on the newest verdict on the line."""

    def look(known: Knowledge) -> _Found:
        found = known.link()
        return None if found is None else (found, words(found.value, known))

    return look


def _flown(known: Knowledge) -> _Found:
    """What the aircraft does; without a NaviCtrl, whether its motors run."""
    return _last("state/flight", Flight, _flight)(known) or _last("health", VehicleHealth, _motors)(known)


_ROWS: Final = (
    FactRow("vehicle", "vehicle", _last("health", VehicleHealth, _vehicle)),
    FactRow("control", "control", _last("control/status", ControlStatus, _control)),
    FactRow("manoeuvre", "manoeuvre", _last("control/status", ControlStatus, _manoeuvre)),
    FactRow("hands", "pilot's hands", _last("control/status", ControlStatus, _hands)),
    FactRow("flight", "flight", _flown),
    FactRow("height", "height", _height),
    FactRow("battery", "battery", _last("state/battery", Battery, _battery)),
    FactRow("pose", "last pose", _pose),
    FactRow("position", "position", _last("control/estimate", ControlEstimate, _estimate)),
    FactRow("error", "from the goal", _last("control/error", ControlError, _error)),
    FactRow("attitude", "attitude", _last("state/attitude", Attitude, _attitude)),
    FactRow("speed", "speed", _last("state/velocity", Velocity, _velocity)),
    FactRow("place", "place", _last("state/position", Position, _place)),
    FactRow("link", "link", _line(_link)),
    FactRow("port", "port", _line(_port)),
    FactRow("latency", "round trip", _last("link/health", LinkHealth, _latency)),
    FactRow("streams", "streams", _last("link/health", LinkHealth, _streams)),
    *(FactRow(name, title, _last("link/health", LinkHealth, _fates(title))) for name, title in FATES.items()),
    FactRow("receiver", "receiver", _last("state/pilot", Pilot, _receiver)),
    FactRow("gps", "GPS", _last("state/gps", Gps, _gps)),
    FactRow("firmware", "firmware", _last("health", VehicleHealth, _firmware)),
    FactRow("recording", "recording", _last("record/status", RecordStatus, _recording)),
)


@lru_cache(maxsize=64)
def rows_of(cameras: tuple[str, ...]) -> Mapping[str, FactRow]:
    """The rows of the table by their words, then two for each camera; one where there is none."""
    rows = [*_ROWS]
    if not cameras:
        rows.append(FactRow("cameras", "cameras", lambda _: None))
    for camera in cameras:
        rows.append(FactRow(f"eye-{camera}", f"camera {camera}", _last(f"vision/{camera}/stats", VisionStats, _eye)))
        rows.append(FactRow(f"sight-{camera}", f"sight {camera}", partial(_sight, camera=camera)))
    return {row.id: row for row in rows}


def fact_of(row: FactRow, known: Knowledge) -> Fact:
    """What a row says now."""
    fact, value = known.remembered(row.id, row.look_at)
    return fact if value is None else Fact(*fact[:7], known.age(value), fact.is_stale)
