"""The gateway put together: the daemon's values to topics, messages of ROS to the deck, services to verbs."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import CancelledError as CallCancelledError
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar

import structlog

from mkdaemon.client import Sample, Vehicle
from mkdaemon.client.lease import load_models
from mkdaemon.client.taskerrors import single_error
from mkdaemon.clock import Clock
from mkdaemon.errors import MkError, ProtocolError
from mkdaemon.gateways.faults import Faults
from mkdaemon.gateways.ros2 import topics
from mkdaemon.gateways.ros2.commands import (
    TWIST,
    TWIST_STAMPED,
    CommandStream,
    age_of,
    newer,
    other_type,
    pad_state,
    path_request,
    position_fields,
    setpoint_frame,
    velocity_fields,
)
from mkdaemon.gateways.ros2.deck import FlightDeck
from mkdaemon.gateways.ros2.diagnostics import report
from mkdaemon.gateways.ros2.messages import ConversionScene, Types, name_part
from mkdaemon.gateways.ros2.parameters import (
    PARAMETERS,
    RATES,
    SETTINGS,
    BoardSettings,
    NodeSettings,
    Pace,
    settings_of,
)
from mkdaemon.gateways.ros2.services import SERVICES, Desk, Service, answer, refused
from mkdaemon.gateways.ros2.topics import TOPICS, Newest, Quality, Ros2Topic
from mkdaemon.reading.diagnoses import Diagnosis, DiagnosticLevel
from mkdaemon.reading.known import MOST_CAMERAS

if TYPE_CHECKING:  # rclpy is loaded where a node is made
    from mkdaemon.gateways.ros2.rclnode import RosNode

STALE: Final = 0.3
"""A setpoint whose stamp was older when it came is not flown [s]; docs/safety.md."""
MOST_CALLS: Final = 8
"""Services that may be under way at once; a further call is refused."""
_log = structlog.get_logger("gateway.ros2")
_Result = TypeVar("_Result")


_Outlet = tuple[Ros2Topic, str, Any]
"""Where the messages of a row and a key go: name of the topic, and publisher, None where its type is not installed."""


def _is_wanted(row: Ros2Topic, _: str, publisher: Any, *, is_last: bool) -> bool:
    """Whether a message has to be made: a node reads it, or will get it later, which alone gets a last value."""
    is_latched = row.quality is Quality.LATCHED
    return publisher is not None and (is_latched or (not is_last and publisher.get_subscription_count() > 0))


class Publishing:
    """The daemon's values to topics, on the thread that they come on: the loop would be a second one to be woken.

    Attributes:
        newest: newest values that conversions look at.
        missing: types whose packages are not installed.
        faults: each ended the one message of a value that met it.
    """

    def __init__(
        self, node: RosNode, rows: Sequence[Ros2Topic], scene: ConversionScene, newest: Newest, pace: Pace
    ) -> None:
        self.newest, self.missing, self.faults = newest, set[str](), Faults("ros2")
        self._node, self._rows, self._scene, self._pace = node, rows, scene, pace
        self._publishers: dict[str, Any] = {}
        self._outlets: dict[str, list[_Outlet]] = {}
        self._cameras: set[str] = set()
        self._lock = threading.Lock()
        self._is_closed = False
        for row in rows:
            if "*" not in row.key:
                self._publisher(row, row.name)

    def take(self, sample: Sample, *, is_last: bool = False) -> None:
        """Publish a value if a node reads it; from any thread.

        Args:
            sample: as it came.
            is_last: a last value from before the start: only who gets one late anyway gets it.
        """
        with self._lock:
            is_older = is_last and sample.suffix in self.newest.values
            if not self._is_closed and not is_older:
                self._take(sample, is_last=is_last)

    def close(self) -> None:
        """Publish nothing from now on: the node is about to end."""
        with self._lock:
            self._is_closed = True

    def _take(self, sample: Sample, *, is_last: bool) -> None:
        if not self._is_known(sample.suffix):
            return
        wanted = [one for one in self._outlets_of(sample.suffix) if _is_wanted(*one, is_last=is_last)]
        keeps = self.newest.keeps(sample.suffix)
        if not wanted and not keeps:
            return
        try:
            value = sample.value
        except ProtocolError as error:
            _log.warning("not_understood", key=sample.suffix, words=str(error))
            return
        for row, name, publisher in wanted:
            if self._pace.lets_through(row.word, name, value.stamp.monotonic):
                with self.faults.contained(name):  # a stranger may put numbers that no message can have
                    for message in row.messages(value, self._scene):
                        publisher.publish(message)
        if keeps:
            self.newest.keep(sample.suffix, value)

    def _is_known(self, suffix: str) -> bool:
        """Whether a key is of a camera that has its publishers, or of none."""
        head, _, rest = suffix.partition("/")
        name = rest.partition("/")[0]
        if head == "vision" and len(self._cameras) < MOST_CAMERAS:
            self._cameras.add(name)
        return head != "vision" or name in self._cameras

    def _outlets_of(self, suffix: str) -> list[_Outlet]:
        if suffix not in self._outlets:
            named = [(row, row.name_for(suffix)) for row in self._rows if row.is_of(suffix)]
            self._outlets[suffix] = [(row, name, self._publisher(row, name)) for row, name in named]
        return self._outlets[suffix]

    def _publisher(self, row: Ros2Topic, name: str) -> Any:
        if name not in self._publishers:
            self._publishers[name] = self._node.publisher(name, row.type, row.quality)
            if self._publishers[name] is None and row.type not in self.missing:
                self.missing.add(row.type)
                package = row.type.partition("/")[0].replace("_", "-")
                _log.warning("left_out", topic=name, words=f"{row.type} is not installed: ros-DISTRO-{package}")
        return self._publishers[name]


class Ros2Gateway:
    """One vehicle in ROS.

    Attributes:
        deck: chooses the command source.
        publishing: what is published.
    """

    def __init__(self, uav: Vehicle, node: RosNode, types: Types) -> None:
        load_models()  # seconds on a slow machine, in which no pad would be heard
        self._loop = asyncio.get_running_loop()
        self._uav, self._node = uav, node
        self._pace = Pace({})
        given = node.parameters(PARAMETERS, self._changed, self._asked)
        self._board = BoardSettings(uav, node.declare)
        self._settings: NodeSettings = settings_of(given)
        self._pace.rates |= {key.removeprefix(RATES): float(given[key]) for key in given if key.startswith(RATES)}
        newest = Newest()
        self._scene = ConversionScene(types, self._settings.frames, newest.values, uav.vehicle)
        rows = [row for row in TOPICS if row.word in self._settings.topics]
        self.publishing = Publishing(node, rows, self._scene, newest, self._pace)
        self.deck = FlightDeck(uav, self._settings.habits, newest.values)
        self._keys = topics.keys_of(rows)
        self._clock = Clock()
        self._calls: set[Future[Any]] = set()
        self._is_ending = False
        self._diagnostics = node.publisher(topics.DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", Quality.RELIABLE)
        self._pad_stamp: Any = None
        self._subscribed: dict[str, str] = {}
        self._mistyped: frozenset[str] = frozenset()
        self._offer()

    def _changed(self, name: str, value: Any) -> None:
        if name.startswith(RATES):
            self._pace.rates[name.removeprefix(RATES)] = float(value)

    def _offer(self) -> None:
        """Subscribe to what flies, and offer services."""
        settings, desk = self._settings, Desk(self._uav, self.deck, self._scene, self._board)
        velocity = partial(self._setpoint, self.deck.velocity, "velocity", velocity_fields, settings.velocity_frame)
        pose = partial(self._setpoint, self.deck.pose, "position", position_fields, settings.pose_frame)
        flying = {
            "joy": ("sensor_msgs/msg/Joy", self._joy),
            "cmd_vel": (TWIST_STAMPED if settings.is_stamped else TWIST, velocity),
            "cmd_vel_stamped": (TWIST_STAMPED, velocity),
            "setpoint_pose": ("geometry_msgs/msg/PoseStamped", pose),
            "path": ("nav_msgs/msg/Path", self._path),
        }
        for name, (kind, take) in flying.items() if settings.commands else ():
            self._node.subscribe(name, kind, partial(self._hand_over, take, name))
            self._subscribed[name] = kind
        for service in SERVICES:
            if settings.commands or not service.flies:
                self._node.serve(service.name, service.type, partial(self._serve, service, desk))

    # -- on threads of rclpy ----------------------------------------------------------------------------------------

    def _hand_over(self, take: Any, name: str, message: Any) -> None:
        with suppress(RuntimeError):  # the loop may be closing
            self._loop.call_soon_threadsafe(self._fly, take, name, message)

    def _asked(self, name: str, value: Any) -> str:
        """Write a setting; why it is refused, empty where it was written."""
        if not name.startswith(SETTINGS):
            return ""
        try:
            self._wait_for(self._board.write(name, value))
        except MkError as error:
            return str(error)
        return ""

    def _serve(self, service: Service, desk: Desk, request: Any) -> dict[str, Any]:
        if len(self._calls) >= MOST_CALLS:
            return refused(service, self._scene, f"{MOST_CALLS} calls are under way: wait for their answers")
        try:
            return self._wait_for(answer(service, desk, request))
        except MkError as error:
            return refused(service, self._scene, str(error))

    def _wait_for(self, work: Coroutine[Any, Any, _Result]) -> _Result:
        """Do something on the loop, and wait for it on a thread of ROS.

        Raises:
            MkError: the gateway ends, or what the work raises.
        """
        call: Future[_Result] | None = None
        try:
            call = asyncio.run_coroutine_threadsafe(work, self._loop)
            self._calls.add(call)
            if self._is_ending:
                call.cancel()
            return call.result()
        except (CallCancelledError, RuntimeError):
            raise MkError("the gateway ends") from None
        finally:
            if call is not None:
                self._calls.discard(call)

    # -- on the loop ------------------------------------------------------------------------------------------------

    def _fly(self, take: Any, name: str, message: Any) -> None:
        """Take a message that flies; the deck notes what cannot be flown."""
        try:
            take(name, message)
        except MkError as error:
            self.deck.refused(str(error))

    def _joy(self, _: str, message: Any) -> None:
        stamp = message.header.stamp
        if newer(stamp, self._pad_stamp):
            self._pad_stamp = (stamp.sec, stamp.nanosec)
            state = pad_state(message, self._settings.axes, self._settings.buttons)
            self.deck.pad_arrived(state, age_of(stamp, time.time()))

    def _path(self, name: str, message: Any) -> None:
        """Take a path.

        Raises:
            MkError: it is in another frame than a target's, or holds what is no number.
        """
        frames = self._settings.frames
        if setpoint_frame(message.header.frame_id, frames, "pad") != "pad":
            raise MkError(f"a {name} lies in the frame of a target: give it in {frames.target('NAME')}")
        self.deck.path_arrived(path_request(message, self._settings.path_speed))

    def _setpoint(
        self, stream: CommandStream, kind: str, fields: Callable[..., Any], frame: str, name: str, message: Any
    ) -> None:
        """Take a setpoint; one with a header is as old as its stamp, and in the frame that it names.

        Raises:
            MkError: it is too old, in a frame that nothing is flown in, or holds what is no number.
        """
        if hasattr(message, "header"):
            age = age_of(message.header.stamp, time.time())
            if age > STALE:
                raise MkError(f"{name} was {age:.1f} s old when it came: look at the clocks, or at the way it took")
            frame = setpoint_frame(message.header.frame_id, self._settings.frames, frame)
            message = message.twist if kind == "velocity" else message.pose
        self.deck.command_arrived(stream, kind, fields(message, frame))

    def end_calls(self) -> None:
        """Answer every service that is under way, and every one from now on, that the gateway ends."""
        self._is_ending = True
        for call in tuple(self._calls):
            call.cancel()

    async def run(self) -> None:
        """Work until it is cancelled; then the lease is given back."""
        jobs: list[Coroutine[Any, Any, None]] = [self.deck.run(), self._publish(), self._report()]
        with single_error():
            async with asyncio.TaskGroup() as tasks:
                for job in jobs:
                    tasks.create_task(job, name="gateway ros2")

    async def _publish(self) -> None:
        with ExitStack() as subscribed:
            subscribed.callback(self.publishing.close)
            for key in self._keys:
                subscribed.enter_context(self._uav.each(key, self.publishing.take))
            for key in sorted(topics.KEPT):
                for sample in (await self._uav.get_all(key)).values():
                    self.publishing.take(sample, is_last=True)
            await asyncio.Event().wait()  # until it is cancelled

    async def _report(self) -> None:
        while True:
            await asyncio.sleep(topics.REPORTING)
            missing = ", ".join(sorted(self.publishing.missing))
            mistyped = self._look_for_other_types()
            values = {"flown": self.deck.flown, "not_installed": missing, "other_type": "; ".join(mistyped)}
            level = DiagnosticLevel.WARN if missing or mistyped else DiagnosticLevel.OK
            mine = Diagnosis("gateway", level, " ".join((*mistyped, self.deck.words)), values)
            with self.publishing.faults.contained(topics.DIAGNOSTICS):
                self._diagnostics.publish(report(self._scene, self._clock.stamp(), mine))

    def _look_for_other_types(self) -> list[str]:
        """Name every topic that flies and has a publisher of a type that is not subscribed; log each once."""
        found = []
        for name, kind in self._subscribed.items():
            found += [other_type(name, kind, one) for one in sorted(self._node.types_published(name) - {kind})]
        for words in found:
            if words not in self._mistyped:
                _log.warning("other_type", words=words)
        self._mistyped = frozenset(found)
        return found


async def run(uav: Vehicle, arguments: Sequence[str], namespace: str | None, on_ready: Callable[[str], None]) -> None:
    """Be the gateway of a vehicle until it is cancelled.

    Args:
        uav: the daemon's client.
        arguments: of ROS.
        namespace: of its topics; the vehicle's name unless given.
        on_ready: called with the namespace once everything is offered.

    Raises:
        ConfigError: ROS does not take the arguments, or a parameter cannot be.
        ModuleNotFoundError: rclpy, or a type that is always needed, is not installed.
    """
    from mkdaemon.gateways.ros2.rclnode import RosNode, RosTypes, localhost_only

    localhost_only()
    node = RosNode(f"/{name_part(namespace or uav.vehicle)}", arguments)
    try:
        gateway = Ros2Gateway(uav, node, RosTypes())
        node.start()
        on_ready(node.namespace)
        try:
            await gateway.run()
        finally:
            gateway.end_calls()  # the node waits for them when it is closed
    finally:
        await asyncio.to_thread(node.close)
