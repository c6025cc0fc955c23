"""A gateway without a network: a vehicle that is told what to answer, and a ground station that keeps what it hears."""

from __future__ import annotations

import asyncio
import inspect
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace

from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.boardset import STORED
from mkdaemon.gateways.mavlink.framing import Encoder
from mkdaemon.gateways.mavlink.gateway import MavlinkGateway, Options
from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.gateways.mavlink.stations import Station
from mkdaemon.protocol.settings import ParameterSet, layout_of
from mkdaemon.telemetry.control import ControlStatus, LeaseState, Phase
from mkdaemon.telemetry.link import LinkCondition, LinkHealth, LinkState
from mkdaemon.telemetry.mission import WaypointList, WaypointsStored
from mkdaemon.telemetry.navi import ControlNavi, NaviStage
from mkdaemon.telemetry.preflight import PreflightReport
from mkdaemon.telemetry.procedure import ProcedureProgress
from mkdaemon.telemetry.settings import SettingsBackup, SettingsRestoration, StoredSet
from mkdaemon.telemetry.state import Flight, GpsMode
from mkdaemon.virtualtime import run_virtually
from tests import samples
from tests.client.sessionlease import SessionLease
from tests.values import LEVEL, made

EPOCH = 7
GROUND_STATION = (255, 190)
WALL = 1_700_000_000.0
NAN = float("nan")
LAT, LON = 532_301_184, 74_590_749
FIELDS = ("seq", "frame", "command", "current", "autocontinue", "param1", "param2", "param3", "x", "y", "z")
"""Of an item, without its heading, which may be NaN."""
NOWHERE = Path("/nonexistent")

ATTITUDE = samples.attitude(pitch=0.2, yaw=0.5, quaternion=LEVEL)
POSITION, VELOCITY, BATTERY, GPS, PILOT = (
    make() for make in (samples.position, samples.velocity, samples.battery, samples.gps, samples.pilot)
)
ALTITUDE = samples.altitude(above_start=3.0)
HEALTH = samples.alive(boards=("fc", "nc"), firmware={"fc": "2.12a", "nc": "2.12a"})
ESTIMATE = samples.estimate(position=(0.3, -0.2, 2.0), velocity=(0.1, 0.2, -0.3), yaw=0.25)
POSE = samples.pose(
    position_target=(0.3, -0.2, 2.0), position_flu=(-0.3, 0.2, -2.0), position_cam=(0.2, 0.1, 2.0),
    covariance=tuple(float(row + 1) if row == column else 0.0 for row in range(6) for column in range(6)),
)  # fmt: skip


def flight(**changes):
    """What the boards say of a flight; in the air, steered by the pilot."""
    known = {"motors_running": True, "is_flying": True, "battery_low": False, "altitude_control": False}
    more = {"gps_mode": GpsMode.FREE, "source": "nc/osd", "flying_time": 20.0, "waypoint_index": 0, "waypoint_count": 0}
    return made(Flight, **known | more | changes)


def status(phase=Phase.FREE, *, epoch=None, **changes):
    """What the daemon says of its authority."""
    lease = None if epoch is None else LeaseState(holder="gateway", epoch=epoch, ttl=5.0, left=5.0)
    return made(ControlStatus, phase=phase, lease=lease, **{"reason": "because", "external_control": "v2"} | changes)


def navi(stage=NaviStage.FREE, **changes):
    """What the NaviCtrl flies."""
    return made(ControlNavi, stage=stage, **changes)


def line(condition=LinkCondition.UP):
    """What is said of the line."""
    return made(LinkHealth, state=made(LinkState, condition=condition), echo={"loss_percent": 1.5})


EVERYTHING = (
    *(ATTITUDE, POSITION, VELOCITY, ALTITUDE, BATTERY, GPS, PILOT, HEALTH, ESTIMATE, POSE),
    *(flight(), status(), navi(), line()),
)
"""A value of every kind."""


REVISION = 106
RAW = bytes([REVISION]) + bytes(number % 200 for number in range(1, layout_of(REVISION).size))
"""The active set of a vehicle."""


def item(seq, command=16, frame=6, params=(2.0, 5.0, 0.0, NAN), place=(LAT, LON, 10.0), more=1):
    """An item of a mission."""
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, int(seq == 0), more, *params, *place, 0)


def parts(items):
    """Everything in items but their headings."""
    return [tuple(getattr(message, name) for name in FIELDS) for message in items]


def progress(step):
    """How far a write of one set is."""
    return made(ProcedureProgress, id="1", verb="settings_write", state="running", step=step, of=3, text="words")


class FakeLease(SessionLease):
    """A lease of a `FakeVehicle`."""

    def __init__(self, vehicle):
        super().__init__(EPOCH, engages=None)
        self.vehicle = vehicle

    def send(self, setpoint):
        super().send(setpoint)
        if setpoint is None:
            return
        kind, fields = self.streamed[-1]
        vehicle = self.vehicle
        vehicle.setpoints.append((asyncio.get_running_loop().time(), kind, fields))
        if vehicle.refuses is not None:
            self.refuse(vehicle.refuses)
        elif len(vehicle.setpoints) >= vehicle.engages:
            self.report(Phase.FLYING, manoeuvre=kind)


class FakeVehicle:
    """What a gateway asks of a vehicle, and what it was asked.

    Attributes:
        calls: every call, by name and arguments.
        setpoints: every setpoint with its time.
        points: the list of the NaviCtrl.
        raw: the active set.
        refusals: what a call raises, by its name.
        engages: setpoints after which the daemon flies.
        refuses: why setpoints are refused.
        report: of the checks before a flight.
        take: takes a sample on the thread that calls it.
        slow: time that every call takes [s].
    """

    def __init__(self):
        self.calls, self.setpoints, self.points, self.refusals = [], [], (), {}
        self.raw = RAW
        self.engages, self.refuses, self.slow = 3, None, 0.0
        self.take = None
        self.lease_now, self.report = None, PreflightReport(is_ready=True, findings=())
        self.settings = self.waypoints = self.route = self.navi = self.records = _Calls(self)

    @property
    def done(self):
        """The names of all calls."""
        return [name for name, *_ in self.calls]

    async def call(self, name, *arguments, **options):
        """Answer one call."""
        on_progress = options.pop("on_progress", None)
        self.calls.append((name, arguments, options))
        await asyncio.sleep(self.slow / 3)
        if on_progress is not None and self.refusals.get(name) is None:
            on_progress(progress(STORED))
        await asyncio.sleep(2 * self.slow / 3)
        if (refusal := self.refusals.get(name)) is not None:
            raise refusal
        digest = f"{hash(self.points) & 0xFFFF:x}"
        match name:
            case "backup":
                return SettingsBackup(firmware="2.12a", active=3, sets=(StoredSet(slot=3, raw=self.raw),))
            case "write":
                before = StoredSet(slot=3, raw=self.raw)
                self.raw = ParameterSet(self.raw).replaced(_plain(arguments[0])).raw
                stored = (StoredSet(slot=3, raw=self.raw),)
                return SettingsRestoration(firmware="2.12a", active=3, before=(before,), stored=stored, written=(3,))
            case "upload":
                self.points = tuple(arguments[0])
                digest = f"{hash(self.points) & 0xFFFF:x}"
                return WaypointsStored(count=len(self.points), digest=digest)
            case "clear" | "end":
                self.points = ()
                return WaypointsStored(count=0, digest="none")
            case "read":
                return WaypointList(points=self.points, digest=digest if self.points else "none")
        return SimpleNamespace(switch="turned to coming home it flies", count=3, verb="settings_backup")

    @asynccontextmanager
    async def lease(self, session, **options):
        self.calls.append(("lease", (), options))
        if (refusal := self.refusals.get("lease")) is not None:
            raise refusal
        self.lease_now = FakeLease(self)
        self.lease_now.grant(session)
        try:
            yield self.lease_now
        finally:
            self.calls.append(("give back", (), {}))
            self.lease_now = None

    async def abort(self, reason):
        await self.call("abort", reason)

    async def stop(self, **options):
        await self.call("stop", **options)

    async def cancel(self):
        return await self.call("cancel")

    async def preflight(self):
        await self.call("preflight")
        return self.report

    async def request(self, board, message, **options):
        await self.call("request", message, **options)

    def each(self, _, take):
        self.take = take
        return nullcontext()

    async def get_all(self, _):
        return {}


class _Calls:
    def __init__(self, vehicle):
        self._vehicle = vehicle

    def __getattr__(self, name):
        return lambda *arguments, **options: self._vehicle.call(name, *arguments, **options)


def _plain(values):
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


class Ears:
    """A ground station with pymavlink's own parser and packer; it sends an item whenever it is asked for one.

    Attributes:
        items: the mission that it uploads.
        deaf_to: items that it does not send.
    """

    items = ()
    deaf_to = ()

    def __init__(self, gateway, numbering=Numbering.PX4, program=GROUND_STATION):
        self.heard = []
        self.gateway, self.program = gateway, program
        self._parser = mavlink.MAVLink(None)
        self.station = Station("test", numbering, Encoder(1, None), self._take, lambda: WALL)
        gateway.links._stations[self.station] = lambda: None
        self.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))

    def _take(self, data):
        heard = self._parser.parse_buffer(data) or []
        self.heard += heard
        for message in heard:
            if message.get_type() == "MISSION_REQUEST_INT" and message.seq not in self.deaf_to:
                asyncio.get_running_loop().call_later(0.01, self.send_item, message.seq)
        return True

    def say(self, message):
        """Send the gateway a message, over the bytes."""
        packer = mavlink.MAVLink(None, *self.program)
        decoded = mavlink.MAVLink(None).decode(bytearray(message.pack(packer)))
        self.gateway.message_arrived(self.station, decoded)

    def command(self, number, *params, frame=None, confirmation=0, target=(1, 1)):
        """Send a command; COMMAND_INT where there is a frame."""
        numbers = [*params, *[0] * (7 - len(params))]
        if frame is None:
            self.say(mavlink.MAVLink_command_long_message(*target, number, confirmation, *numbers))
            return
        self.say(mavlink.MAVLink_command_int_message(*target, frame, number, 0, 0, *numbers))

    async def ask(self, message, seconds=0.5):
        """Send a message and let time pass."""
        self.say(message)
        await beat(self, seconds)

    async def order(self, number, *params, seconds=0.5, **more):
        """Send a command and let time pass."""
        self.command(number, *params, **more)
        await beat(self, seconds)

    def named(self, name):
        """What was heard of a message."""
        return [message for message in self.heard if message.get_type() == name]

    def send_item(self, seq):
        if seq < len(self.items):
            self.say(self.items[seq])

    async def upload(self, items, seconds=0.6):
        """Send a mission; the result."""
        self.items = items
        self.heard.clear()
        self.say(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        await beat(self, seconds)
        return self.results

    async def download(self):
        """Ask for a mission; its items."""
        self.heard.clear()
        self.say(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
        await beat(self, 0.2)
        for seq in range(self.named("MISSION_COUNT")[0].count):
            self.say(mavlink.MAVLink_mission_request_int_message(1, 1, seq, 0))
            await asyncio.sleep(0.01)
        self.say(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
        return self.named("MISSION_ITEM_INT")

    @property
    def acks(self):
        """Command and result of every COMMAND_ACK."""
        return [(message.command, message.result) for message in self.named("COMMAND_ACK")]

    @property
    def results(self):
        """Of every MISSION_ACK."""
        return [message.type for message in self.named("MISSION_ACK")]

    @property
    def words(self):
        """All texts, in one line."""
        return "".join(message.text for message in self.named("STATUSTEXT"))


@asynccontextmanager
async def serving(vehicle=None, *, folder=NOWHERE, values=EVERYTHING):
    """A gateway that runs on the loop's clock; what is given is known to it."""
    loop = asyncio.get_running_loop()
    gateway = MavlinkGateway(vehicle or FakeVehicle(), Options((), 1, None, folder), loop.time, lambda: WALL)
    ready = asyncio.Event()
    task = asyncio.create_task(gateway.run(ready.set))
    await ready.wait()
    for value in values:
        gateway.value_arrived(value)
    try:
        yield gateway
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def virtually(story, kind=None):
    """Run a test in virtual time; its arguments `vehicle` (of a kind), `gateway`, `ears` are a gateway that serves.

    Settings are saved in the folder of its argument `tmp_path`.
    """
    signature = inspect.signature(story)
    wanted = signature.parameters.keys() & {"vehicle", "gateway", "ears"}

    async def served(**options):
        vehicle = (kind or FakeVehicle)()
        folder = options.get("tmp_path", NOWHERE)
        async with serving(vehicle, folder=folder) as gateway:
            made = {"vehicle": vehicle, "gateway": gateway}
            if "ears" in wanted:
                made["ears"] = Ears(gateway)
            await story(**{name: made[name] for name in wanted}, **options)

    def run(*arguments, **options):
        named = dict(zip(run.__signature__.parameters, arguments, strict=False))  # Hypothesis gives them without names
        run_virtually((served if wanted else story)(**named, **options))

    run.__name__, run.__doc__ = story.__name__, story.__doc__
    given = [parameter for name, parameter in signature.parameters.items() if name not in wanted]
    run.__signature__ = signature.replace(parameters=given)
    run.pytestmark = getattr(story, "pytestmark", [])
    return run


async def beat(ears, seconds, also=lambda: None):
    """Let time pass, with a heartbeat a second."""
    for step in range(round(seconds * 20)):
        if step % 20 == 0:
            ears.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        also()
        await asyncio.sleep(0.05)
