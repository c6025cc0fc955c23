"""The values of every key, typed: `uav.state.attitude()`, `uav.vision(camera).pose()`.

Made by `python -m tools.docs` from bus/keys.py; do not edit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import zenoh

from mkdaemon.client.streams import Stream, part_of_key
from mkdaemon.client.transport import Transport

if TYPE_CHECKING:
    from mkdaemon.telemetry.control import ControlError, ControlEstimate, ControlFence, ControlOutput, ControlStatus
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
    from mkdaemon.telemetry.sim import ScenePose, SimFaults, SimTruth
    from mkdaemon.telemetry.state import Altitude, Attitude, Battery, Flight, Gps, Pilot, Position, Velocity
    from mkdaemon.telemetry.traffic import FrameSample, RawFrame
    from mkdaemon.telemetry.vehicle import VehicleHealth
    from mkdaemon.telemetry.vision import CameraSetup, PoseRefused, Tags, Transform, VisionPose, VisionStats


class RawKeys:
    """Streams of `raw/...`."""

    def __init__(self, transport: Transport) -> None:
        self.rx: Stream[RawFrame] = Stream(transport, "raw/rx", "traffic:RawFrame")
        """`raw/rx`, every frame and every loss: Bytes received, and why they were dropped if they were."""
        self.tx: Stream[RawFrame] = Stream(transport, "raw/tx", "traffic:RawFrame")
        """`raw/tx`, every frame: Bytes sent, and what for."""


class StateKeys:
    """Streams of `state/...`."""

    def __init__(self, transport: Transport) -> None:
        self.attitude: Stream[Attitude] = Stream(transport, "state/attitude", "state:Attitude")
        """`state/attitude`, every C (O where there is none): Orientation."""
        self.position: Stream[Position] = Stream(transport, "state/position", "state:Position")
        """`state/position`, every O with a valid position: Position, home, altitude."""
        self.altitude: Stream[Altitude] = Stream(transport, "state/altitude", "state:Altitude")
        """`state/altitude`, every O; FlightCtrl D: Height by the barometer."""
        self.velocity: Stream[Velocity] = Stream(transport, "state/velocity", "state:Velocity")
        """`state/velocity`, every O with a valid position: Velocity."""
        self.battery: Stream[Battery] = Stream(transport, "state/battery", "state:Battery")
        """`state/battery`, every O; FlightCtrl D: Voltage, current, charge used."""
        self.gps: Stream[Gps] = Stream(transport, "state/gps", "state:Gps")
        """`state/gps`, every O: Satellites and fix."""
        self.flight: Stream[Flight] = Stream(transport, "state/flight", "state:Flight")
        """`state/flight`, every O: What the aircraft is doing, its flags and its error."""
        self.pilot: Stream[Pilot] = Stream(transport, "state/pilot", "state:Pilot")
        """`state/pilot`, every O; FlightCtrl D: Receiver quality and the pilot's sticks."""


class LinkKeys:
    """Streams of `link/...`."""

    def __init__(self, transport: Transport) -> None:
        self.state: Stream[LinkState] = Stream(transport, "link/state", "link:LinkState")
        """`link/state`, on change: The verdict on the line, its reason and since when."""
        self.health: Stream[LinkHealth] = Stream(transport, "link/health", "link:LinkHealth")
        """`link/health`, 5 Hz and on change: Round trips, losses, rates and ages of streams."""
        self.traffic: Stream[LinkTraffic] = Stream(transport, "link/traffic", "link:LinkTraffic")
        """`link/traffic`, 1 Hz: Bytes and frames by kind, shares of the line."""


class ControlKeys:
    """Streams of `control/...`."""

    def __init__(self, transport: Transport) -> None:
        self.status: Stream[ControlStatus] = Stream(transport, "control/status", "control:ControlStatus")
        """`control/status`, 1 Hz and on change: Phase, holder and reason; values that change with every stick frame
        are in `output`, `estimate` and `error`."""
        self.estimate: Stream[ControlEstimate] = Stream(transport, "control/estimate", "control:ControlEstimate")
        """`control/estimate`, every stick frame in the air: Estimate of the aircraft."""
        self.preflight: Stream[ControlPreflight] = Stream(transport, "control/preflight", "preflight:ControlPreflight")
        """`control/preflight`, when asked for: What was found before a flight, with fixes."""
        self.error: Stream[ControlError] = Stream(transport, "control/error", "control:ControlError")
        """`control/error`, every autonomous stick frame: How far it is from its goal."""
        self.path: Stream[PathFlown] = Stream(transport, "control/path", "path:PathFlown")
        """`control/path`, 1 Hz and on change while one is flown: The path that is flown, and how far."""
        self.output: Stream[ControlOutput] = Stream(transport, "control/output", "control:ControlOutput")
        """`control/output`, every stick frame handed over: Sticks for the line, after the limiter."""
        self.fence: Stream[ControlFence] = Stream(transport, "control/fence", "control:ControlFence")
        """`control/fence`, every 10 s: Where autonomous flight ends."""
        self.navi: Stream[ControlNavi] = Stream(transport, "control/navi", "navi:ControlNavi")
        """`control/navi`, on change; 1 Hz while it flies: What the NaviCtrl flies by itself."""


class VisionCameraKeys:
    """Streams of `vision/<camera>/...`."""

    def __init__(self, transport: Transport, camera: str) -> None:
        self.tags: Stream[Tags] = Stream(transport, f"vision/{part_of_key(camera)}/tags", "vision:Tags")
        """`vision/<camera>/tags`, every image that was searched: Tags found, with their corners."""
        self.pose: Stream[VisionPose] = Stream(transport, f"vision/{part_of_key(camera)}/pose", "vision:VisionPose")
        """`vision/<camera>/pose`, every image with a pose: The vehicle against a target."""
        self.refused: Stream[PoseRefused] = Stream(
            transport, f"vision/{part_of_key(camera)}/refused", "vision:PoseRefused"
        )
        """`vision/<camera>/refused`, every image whose pose is refused: Why an image that shows a target gave no
        pose."""
        self.stats: Stream[VisionStats] = Stream(transport, f"vision/{part_of_key(camera)}/stats", "vision:VisionStats")
        """`vision/<camera>/stats`, 1 Hz and on change: Rate, latency, refusals, what is in the way."""
        self.image: Stream[CameraFrame] = Stream(transport, f"vision/{part_of_key(camera)}/image", "image:CameraFrame")
        """`vision/<camera>/image`, as configured: What the camera saw."""
        self.setup: Stream[CameraSetup] = Stream(transport, f"vision/{part_of_key(camera)}/setup", "vision:CameraSetup")
        """`vision/<camera>/setup`, every 10 s: Lens, mount and targets of a camera, from its files."""


class EventKeys:
    """Streams of `event/...`."""

    def __init__(self, transport: Transport) -> None:
        self.command: Stream[CommandEvent] = Stream(transport, "event/command", "event:CommandEvent")
        """`event/command`, every command: Every request: client, decision, reason."""
        self.mode: Stream[ModeEvent] = Stream(transport, "event/mode", "event:ModeEvent")
        """`event/mode`, on change: Authority or flight mode changed."""
        self.failsafe: Stream[FailsafeEvent] = Stream(transport, "event/failsafe", "event:FailsafeEvent")
        """`event/failsafe`, on occurrence: The daemon released without a request."""
        self.mission: Stream[MissionEvent] = Stream(transport, "event/mission", "mission:MissionEvent")
        """`event/mission`, on change: A waypoint list was stored, cleared, started or left incomplete."""
        self.progress: Stream[ProcedureProgress] = Stream(transport, "event/progress", "procedure:ProcedureProgress")
        """`event/progress`, every step: How far a procedure is, and how it ended."""
        self.clock: Stream[ClockEvent] = Stream(transport, "event/clock", "event:ClockEvent")
        """`event/clock`, on occurrence: The system clock was set: how far, and which way."""
        self.mark: Stream[MarkEvent] = Stream(transport, "event/mark", "record:MarkEvent")
        """`event/mark`, on occurrence: A client marked this moment for the recordings."""
        self.log: Stream[LogEvent] = Stream(transport, "event/log", "event:LogEvent")
        """`event/log`, on occurrence: Other things worth knowing."""


class SimKeys:
    """Streams of `sim/...`."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self.truth: Stream[SimTruth] = Stream(transport, "sim/truth", "sim:SimTruth")
        """`sim/truth`, 50 Hz: The simulator's true state; never read by flight code."""
        self.pose: Stream[ScenePose] = Stream(transport, "sim/pose", "sim:ScenePose")
        """`sim/pose`, as sent: Another simulator's pose, for `mkdaemon sim --scene-only`."""
        self.faults: Stream[SimFaults] = Stream(transport, "sim/faults", "sim:SimFaults")
        """`sim/faults`, 1 Hz and on change: Faults the simulator plays."""

    def camera(self, name: str) -> Stream[CameraFrame]:
        """`sim/camera/<name>`, 30 Hz, where it is on: What the simulated camera sees."""
        return Stream(self._transport, f"sim/camera/{part_of_key(name)}", "image:CameraFrame")


class PositionsNameKeys:
    """Streams of `positions/<name>/...`."""

    def __init__(self, transport: Transport, name: str) -> None:
        self.report: Stream[PositionReport] = Stream(
            transport, f"positions/{part_of_key(name)}/report", "position:PositionReport"
        )
        """`positions/<name>/report`, as measured, up to 300 Hz: Pose of the vehicle by a source of `[[positions]]`;
        docs/positions.md."""
        self.health: Stream[PositionHealth] = Stream(
            transport, f"positions/{part_of_key(name)}/health", "position:PositionHealth"
        )
        """`positions/<name>/health`, 1 Hz: What `mkdaemon gateway mocap` says of itself."""


class RecordKeys:
    """Streams of `record/...`."""

    def __init__(self, transport: Transport) -> None:
        self.status: Stream[RecordStatus] = Stream(transport, "record/status", "record:RecordStatus")
        """`record/status`, 1 Hz: What the daemon's own recorder does."""


class BusKeys:
    """Streams of `bus/...`."""

    def __init__(self, transport: Transport) -> None:
        self.counts: Stream[BusCounts] = Stream(transport, "bus/counts", "record:BusCounts")
        """`bus/counts`, 1 Hz: How many values were put, by key."""


class KeyTree(Transport):
    """Every key that carries values, as typed streams."""

    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str) -> None:
        super().__init__(session, vehicle, endpoint)
        self.raw: RawKeys = RawKeys(self)
        """Streams of `raw/...`."""
        self.state: StateKeys = StateKeys(self)
        """Streams of `state/...`."""
        self.link: LinkKeys = LinkKeys(self)
        """Streams of `link/...`."""
        self.control: ControlKeys = ControlKeys(self)
        """Streams of `control/...`."""
        self.tf: Stream[Transform] = Stream(self, "tf", "vision:Transform")
        """`tf`, every pose; mounts at 1 Hz: One edge of the tree of frames."""
        self.event: EventKeys = EventKeys(self)
        """Streams of `event/...`."""
        self.sim: SimKeys = SimKeys(self)
        """Streams of `sim/...`."""
        self.health: Stream[VehicleHealth] = Stream(self, "health", "vehicle:VehicleHealth")
        """`health`, 1 Hz and on change: Whether the vehicle is alive (the daemon: see `alive`)."""
        self.record: RecordKeys = RecordKeys(self)
        """Streams of `record/...`."""
        self.bus: BusKeys = BusKeys(self)
        """Streams of `bus/...`."""

    def rx(self, board: str, message: str) -> Stream[FrameSample]:
        """`rx/<board>/<message>`, every frame: A message as it came; board: `fc nc mag osd bl`, `other`."""
        return Stream(self, f"rx/{part_of_key(board)}/{part_of_key(message)}", "traffic:FrameSample")

    def tx(self, board: str, message: str) -> Stream[FrameSample]:
        """`tx/<board>/<message>`, every frame: A message as it went; board also `any`."""
        return Stream(self, f"tx/{part_of_key(board)}/{part_of_key(message)}", "traffic:FrameSample")

    def vision(self, camera: str) -> VisionCameraKeys:
        """Streams of `vision/<camera>/...`."""
        return VisionCameraKeys(self, camera)

    def positions(self, name: str) -> PositionsNameKeys:
        """Streams of `positions/<name>/...`."""
        return PositionsNameKeys(self, name)

    def joy(self, pad: str) -> Stream[Joy]:
        """`joy/<pad>`, 50 Hz and on change: A gamepad of another machine: `mkctl teleop --joy`."""
        return Stream(self, f"joy/{part_of_key(pad)}", "joy:Joy")
