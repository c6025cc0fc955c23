"""The one table of all keys. Publishing, queries, schemas and docs/keys.md are made from it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Final

from mkdaemon.bus.keyspec import REQUEST_BYTES, KeySpec, Use
from mkdaemon.telemetry.command import (
    CommandResult,
)
from mkdaemon.telemetry.control import (
    ControlError,
    ControlEstimate,
    ControlFence,
    ControlOutput,
    ControlStatus,
)
from mkdaemon.telemetry.event import ClockEvent, CommandEvent, FailsafeEvent, LogEvent, ModeEvent
from mkdaemon.telemetry.image import CameraFrame
from mkdaemon.telemetry.joy import Joy
from mkdaemon.telemetry.link import LinkHealth, LinkState, LinkTraffic
from mkdaemon.telemetry.mission import MissionEvent
from mkdaemon.telemetry.navi import ControlNavi
from mkdaemon.telemetry.path import PathFlown
from mkdaemon.telemetry.position import PositionHealth, PositionReport
from mkdaemon.telemetry.preflight import ControlPreflight
from mkdaemon.telemetry.procedure import ProcedureProgress
from mkdaemon.telemetry.record import BusCounts, MarkEvent, RecordStatus
from mkdaemon.telemetry.setpoint import SETPOINTS
from mkdaemon.telemetry.sim import FaultRequest, ScenePose, SimFaults, SimTruth
from mkdaemon.telemetry.state import Altitude, Attitude, Battery, Flight, Gps, Pilot, Position, Velocity
from mkdaemon.telemetry.traffic import FrameSample, RawFrame
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.verbs import VERBS
from mkdaemon.telemetry.vision import CameraSetup, PoseRefused, Tags, Transform, VisionPose, VisionStats

__all__ = ["KEYS", "REQUEST_BYTES", "KeySpec", "Use", "find", "fresh_for", "of_use", "roots"]

_P, _Q = Use.PUBLISHED, Use.QUERY

# How old the last value of a key may be and still be the present one [s].
_FAST: Final = 1.0
"""What comes five times a second or more often."""
_BOARD: Final = 1.5
"""What a board sends: the slowest stream comes twice a second."""
_SLOW: Final = 3.5
"""What comes once a second."""
_RARE: Final = 31.0
"""What comes every ten seconds."""
_FLOWN: Final = 0.5
"""What comes with every stick frame."""
_SIGHT: Final = 1.0
"""What a camera sees: the slowest in use delivers five images meanwhile."""
_HELD: Final = math.inf
"""What comes when it changes."""

KEYS: Final[tuple[KeySpec, ...]] = (
    KeySpec(
        "raw/rx", _P, RawFrame, "every frame and every loss", "Bytes received, and why they were dropped if they were."
    ),
    KeySpec("raw/tx", _P, RawFrame, "every frame", "Bytes sent, and what for."),
    KeySpec(
        "rx/<board>/<message>",
        _P,
        FrameSample,
        "every frame",
        "A message as it came; board: `fc nc mag osd bl`, `other`.",
    ),
    KeySpec("tx/<board>/<message>", _P, FrameSample, "every frame", "A message as it went; board also `any`."),
    KeySpec("state/attitude", _P, Attitude, "every C (O where there is none)", "Orientation.", fresh=_BOARD),
    KeySpec("state/position", _P, Position, "every O with a valid position", "Position, home, altitude.", fresh=_BOARD),
    KeySpec("state/altitude", _P, Altitude, "every O; FlightCtrl D", "Height by the barometer.", fresh=_BOARD),
    KeySpec("state/velocity", _P, Velocity, "every O with a valid position", "Velocity.", fresh=_BOARD),
    KeySpec("state/battery", _P, Battery, "every O; FlightCtrl D", "Voltage, current, charge used.", fresh=_BOARD),
    KeySpec("state/gps", _P, Gps, "every O", "Satellites and fix.", fresh=_BOARD),
    KeySpec(
        "state/flight", _P, Flight, "every O", "What the aircraft is doing, its flags and its error.", fresh=_BOARD
    ),
    KeySpec(
        "state/pilot", _P, Pilot, "every O; FlightCtrl D", "Receiver quality and the pilot's sticks.", fresh=_BOARD
    ),
    KeySpec(
        "link/state", _P, LinkState, "on change", "The verdict on the line, its reason and since when.", fresh=_HELD
    ),
    KeySpec(
        "link/health",
        _P,
        LinkHealth,
        "5 Hz and on change",
        "Round trips, losses, rates and ages of streams.",
        fresh=_FAST,
    ),
    KeySpec("link/traffic", _P, LinkTraffic, "1 Hz", "Bytes and frames by kind, shares of the line.", fresh=_SLOW),
    KeySpec(
        *("control/status", _P, ControlStatus, "1 Hz and on change"),
        "Phase, holder and reason; values that change with every stick frame are in `output`, `estimate` and `error`.",
        fresh=_SLOW,
    ),
    KeySpec(
        "control/estimate",
        _P,
        ControlEstimate,
        "every stick frame in the air",
        "Estimate of the aircraft.",
        fresh=_FLOWN,
    ),
    KeySpec(
        "control/preflight",
        _P,
        ControlPreflight,
        "when asked for",
        "What was found before a flight, with fixes.",
        fresh=_HELD,
    ),
    KeySpec(
        "control/error", _P, ControlError, "every autonomous stick frame", "How far it is from its goal.", fresh=_FLOWN
    ),
    KeySpec(
        *("control/path", _P, PathFlown, "1 Hz and on change while one is flown"),
        "The path that is flown, and how far.",
        fresh=_SLOW,
    ),
    KeySpec(
        "control/output",
        _P,
        ControlOutput,
        "every stick frame handed over",
        "Sticks for the line, after the limiter.",
        fresh=_FLOWN,
    ),
    KeySpec("control/fence", _P, ControlFence, "every 10 s", "Where autonomous flight ends.", fresh=_RARE),
    KeySpec(
        "control/navi",
        _P,
        ControlNavi,
        "on change; 1 Hz while it flies",
        "What the NaviCtrl flies by itself.",
        fresh=_HELD,
    ),
    KeySpec(
        "vision/<camera>/tags",
        _P,
        Tags,
        "every image that was searched",
        "Tags found, with their corners.",
        fresh=_SIGHT,
    ),
    KeySpec(
        "vision/<camera>/pose", _P, VisionPose, "every image with a pose", "The vehicle against a target.", fresh=_SIGHT
    ),
    KeySpec(
        *("vision/<camera>/refused", _P, PoseRefused, "every image whose pose is refused"),
        "Why an image that shows a target gave no pose.",
        fresh=_SIGHT,
    ),
    KeySpec(
        "vision/<camera>/stats",
        _P,
        VisionStats,
        "1 Hz and on change",
        "Rate, latency, refusals, what is in the way.",
        fresh=_SLOW,
    ),
    KeySpec("vision/<camera>/image", _P, CameraFrame, "as configured", "What the camera saw.", fresh=_SLOW),
    KeySpec(
        *("vision/<camera>/setup", _P, CameraSetup, "every 10 s"),
        "Lens, mount and targets of a camera, from its files.",
        fresh=_RARE,
    ),
    KeySpec("tf", _P, Transform, "every pose; mounts at 1 Hz", "One edge of the tree of frames."),
    KeySpec("event/command", _P, CommandEvent, "every command", "Every request: client, decision, reason."),
    KeySpec("event/mode", _P, ModeEvent, "on change", "Authority or flight mode changed."),
    KeySpec("event/failsafe", _P, FailsafeEvent, "on occurrence", "The daemon released without a request."),
    KeySpec(
        "event/mission",
        _P,
        MissionEvent,
        "on change",
        "A waypoint list was stored, cleared, started or left incomplete.",
    ),
    KeySpec("event/progress", _P, ProcedureProgress, "every step", "How far a procedure is, and how it ended."),
    KeySpec(
        "sim/truth",
        Use.CLIENT,
        SimTruth,
        "50 Hz",
        "The simulator's true state; never read by flight code.",
        fresh=_FLOWN,
    ),
    KeySpec("sim/pose", Use.CLIENT, ScenePose, "as sent", "Another simulator's pose, for `mkdaemon sim --scene-only`."),
    KeySpec("sim/faults", Use.CLIENT, SimFaults, "1 Hz and on change", "Faults the simulator plays.", fresh=_SLOW),
    KeySpec("sim/camera/<name>", Use.CLIENT, CameraFrame, "30 Hz, where it is on", "What the simulated camera sees."),
    KeySpec(
        *("positions/<name>/report", Use.CLIENT, PositionReport, "as measured, up to 300 Hz"),
        "Pose of the vehicle by a source of `[[positions]]`; docs/positions.md.",
        fresh=_FLOWN,
    ),
    KeySpec(
        *("positions/<name>/health", Use.CLIENT, PositionHealth, "1 Hz"),
        "What `mkdaemon gateway mocap` says of itself.",
        fresh=_SLOW,
    ),
    KeySpec("joy/<pad>", Use.CLIENT, Joy, "50 Hz and on change", "A gamepad of another machine: `mkctl teleop --joy`."),
    KeySpec(
        *("sim/start", _Q, None, "", "The simulated pilot begins now, or once more after a landing; no payload."),
        SimTruth,
    ),
    KeySpec("sim/fault", _Q, FaultRequest, "", "Begin or end a fault of the simulator.", SimFaults),
    KeySpec("event/clock", _P, ClockEvent, "on occurrence", "The system clock was set: how far, and which way."),
    KeySpec("event/mark", _P, MarkEvent, "on occurrence", "A client marked this moment for the recordings."),
    KeySpec("event/log", _P, LogEvent, "on occurrence", "Other things worth knowing."),
    KeySpec(
        "health",
        _P,
        VehicleHealth,
        "1 Hz and on change",
        "Whether the vehicle is alive (the daemon: see `alive`).",
        fresh=_SLOW,
    ),
    KeySpec("record/status", _P, RecordStatus, "1 Hz", "What the daemon's own recorder does.", fresh=_SLOW),
    KeySpec("bus/counts", _P, BusCounts, "1 Hz", "How many values were put, by key.", fresh=_SLOW),
    KeySpec("cmd/<board>/<message>", _Q, CommandResult, "", "A MikroKopter request; its typed reply, or a refusal."),
    *(KeySpec(f"do/{verb.name}", _Q, verb.request, "", verb.about, verb.reply) for verb in VERBS),
    KeySpec("schema/<name>", _Q, None, "", "JSON Schema of `<Name>.v<N>`, as the encoding of every payload names it."),
    *(
        KeySpec(kind.suffix, Use.SETPOINT, kind, "", f"{kind.about}, under a lease: what its holder put.")
        for kind in SETPOINTS
    ),
    KeySpec("alive", Use.TOKEN, None, "", "The daemon is alive."),
    KeySpec("playing", Use.TOKEN, None, "", "A recording is played under this name: `mkctl log play --as`."),
    KeySpec(
        "client/<holder>",
        Use.TOKEN,
        None,
        "",
        "Declared by a client before it takes the lease; its end ends the lease.",
    ),
)
"""Every key of a vehicle."""


def find(suffix: str) -> KeySpec | None:
    """The table's line a concrete suffix belongs to."""
    chunks = suffix.split("/")
    for spec in KEYS:
        pattern = spec.suffix.split("/")
        if len(pattern) == len(chunks) and all(p[0] == "<" or p == c for p, c in zip(pattern, chunks, strict=True)):
            return spec
    return None


def of_use(use: Use) -> Iterator[KeySpec]:
    """All lines of one use."""
    return (spec for spec in KEYS if spec.use is use)


def roots(use: Use) -> tuple[str, ...]:
    """First chunks of all keys of one use, each once."""
    return tuple(dict.fromkeys(spec.suffix.partition("/")[0] for spec in of_use(use)))


@lru_cache(maxsize=512)  # strangers name keys too
def fresh_for(suffix: str) -> float | None:
    """Largest age of a present value of a key [s]; see `KeySpec.fresh`."""
    spec = find(suffix)
    return None if spec is None else spec.fresh
