"""The gateway put together: what comes from ground stations, what comes from the daemon, and the clock."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Coroutine
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mkdaemon.client import Sample, Vehicle
from mkdaemon.client.taskerrors import single_error
from mkdaemon.errors import ProtocolError
from mkdaemon.gateways.faults import Faults
from mkdaemon.gateways.mavlink import picture, texts
from mkdaemon.gateways.mavlink.actions import Actions
from mkdaemon.gateways.mavlink.addresses import Address
from mkdaemon.gateways.mavlink.commands import Asked, CommandDesk, asked_from
from mkdaemon.gateways.mavlink.dialect import BROADCAST, COMPONENT, Message, mavlink
from mkdaemon.gateways.mavlink.handcontrol import HandControl
from mkdaemon.gateways.mavlink.links import Links
from mkdaemon.gateways.mavlink.missions import MissionServer
from mkdaemon.gateways.mavlink.modes import Mode, heartbeat, mode_now
from mkdaemon.gateways.mavlink.parameters import ParameterServer
from mkdaemon.gateways.mavlink.paths import PathMission
from mkdaemon.gateways.mavlink.picture import LinkPicture
from mkdaemon.gateways.mavlink.queries import Queries
from mkdaemon.gateways.mavlink.recordings import LogServer
from mkdaemon.gateways.mavlink.signing import Signing
from mkdaemon.gateways.mavlink.stations import By, Program, Station, Take, is_for
from mkdaemon.gateways.mavlink.steering import ManualSteering
from mkdaemon.gateways.mavlink.telemetry import BY_CLOCK, BY_VALUE, TABLE
from mkdaemon.gateways.mavlink.texts import Texts, text_of
from mkdaemon.telemetry.control import ControlStatus
from mkdaemon.telemetry.mission import MissionEvent
from mkdaemon.telemetry.procedure import ProcedureProgress
from mkdaemon.telemetry.tone import Tone

TICK: Final = 0.05
"""How often the clock is looked at [s]."""
BEAT: Final = 1.0
"""Between two heartbeats [s]."""
_MOST_WORK: Final = 32
"""Answers that are worked on at once; further requests are dropped, and come again."""
_NUMBER: Final = re.compile(r"[-+.\d]+")
REPEATED: Final = 10.0
"""The same verdict, apart from its numbers, is not sent again for this long [s]."""
_SETTINGS: Final = frozenset({"settings_write", "settings_restore"})
_NOTED: Final = (ControlStatus, MissionEvent, ProcedureProgress)
"""Kinds of values from which more follows than the messages they are the source of."""


@dataclass(frozen=True, slots=True)
class Options:
    """How the gateway runs.

    Attributes:
        addresses: where ground stations are met.
        system: number of the aircraft on the network.
        signing: signs and checks messages; None without a key.
        backups: folder of the settings that were found before they are first changed.
        target: name of the target, or place of a map, that is flown by; empty for the one in sight.
    """

    addresses: tuple[Address, ...]
    system: int
    signing: Signing | None
    backups: Path
    target: str = ""


class MavlinkGateway:
    """A vehicle, shown to ground stations and flown for them.

    Attributes:
        links: where they are.
        picture: what is known of the vehicle.
        steering: what is flown for them.
        faults: of the gateway's own; each ended one message.
    """

    def __init__(self, uav: Vehicle, options: Options, now: Callable[[], float], wall: Callable[[], float]) -> None:
        """Put it together.

        Args:
            uav: the vehicle.
            options: see there.
            now: the monotonic clock [s].
            wall: the system clock [s].
        """
        self._loop = asyncio.get_running_loop()
        self._uav, self._options, self._now = uav, options, now
        self.picture, self.faults = LinkPicture(), Faults("mavlink")
        self.links = Links(options.system, options.signing, self.message_arrived, now, wall)
        self.steering = ManualSteering(uav, self.announce, now, self.faults, options.target)
        self._hands = HandControl(self.steering, self.picture, self.notify, now)
        path = PathMission(uav, self.picture, self.steering)
        self._missions = MissionServer(uav, self.picture, self.notify, now, self.faults, path)
        self._parameters = ParameterServer(uav, options.backups, self.notify, now)
        self._logs = LogServer(self.picture, self.notify)
        self._queries = Queries(self.picture, self._mode, self._missions.current, lambda: self._parameters.revision)
        actions = Actions(uav, self.picture, self.steering, self._hands, self.notify, self._parameters, path)
        self._desk = CommandDesk(actions.table() | self._queries.table(), self.notify, self.faults)
        self._takes: dict[str, Take] = {"SET_MODE": self._set_mode}
        self._takes |= self._hands.takes | self._parameters.takes | self._missions.takes
        self._takes |= self._logs.takes | self._queries.takes
        self._texts = Texts()
        self._work: set[asyncio.Task[None]] = set()
        self._tasks: asyncio.TaskGroup | None = None
        self._beat_at, self._beaten = 0.0, Mode.STABILIZED
        self._hands_words = ""
        self._announced: dict[str, float] = {}
        self._was_wrong = False

    async def run(self, on_ready: Callable[[], None]) -> None:
        """Serve until cancelled; the lease is given back then.

        Args:
            on_ready: called when all links are open.

        Raises:
            MkError: a link cannot be opened.
        """
        with single_error():
            async with asyncio.TaskGroup() as tasks:
                self._tasks = tasks
                with ExitStack() as subscribed:
                    try:
                        for pattern in (*picture.READ, *texts.READ, "event/progress"):
                            subscribed.enter_context(self._uav.each(pattern, self._arrived))
                        for address in self._options.addresses:
                            await self.links.open(address, tasks)
                        await self._take_last()
                        on_ready()
                        tasks.create_task(self._clock(), name="clock")
                        await asyncio.Event().wait()  # until it is cancelled
                    finally:
                        self._tasks = None
                        await self._desk.close()
                        await self.steering.close()
                        self.links.close()

    def _arrived(self, sample: Sample) -> None:
        """Take a sample on Zenoh's thread."""
        # A newer daemon may put what is not understood here.
        with self.faults.contained("a value of the daemon"), suppress(ProtocolError):
            self.value_arrived(sample.value)

    async def _take_last(self) -> None:
        """What was published before: values that come seldom are known at once, each as old as it is."""
        for pattern in picture.READ:
            for sample in (await self._uav.get_all(pattern)).values():
                with suppress(ProtocolError):
                    self.picture.take(sample.value, self._now(), sample.age or 0.0)

    def value_arrived(self, value: Any) -> None:
        """Know a value, and send what it is the source of; from any thread. The loop is woken for little of it.

        A value that waits for the loop waits for a second thread to be given a processor.
        """
        now = self._now()
        self.picture.take(value, now)
        for name in BY_VALUE.get(type(value), ()):
            self._send(name, now)
        if isinstance(value, _NOTED) or text_of(value) is not None:
            with suppress(RuntimeError):  # the loop may be closing
                self._loop.call_soon_threadsafe(self._note, value)

    def _note(self, value: Any) -> None:
        """Do on the loop what else follows from a value."""
        with self.faults.contained("a value of the daemon"):
            if isinstance(value, ControlStatus):
                self._announce_hands(value)
                self._announce_verdict()
            elif isinstance(value, MissionEvent):
                self._missions.event_arrived(value)
            elif isinstance(value, ProcedureProgress) and value.verb in _SETTINGS:
                self._parameters.forget()
            if (text := text_of(value)) is not None:
                self.announce(*text)

    def _announce_verdict(self) -> None:
        """The worst that is known, as on every other screen, when it changes; and that nothing is wrong any more."""
        known, now = self.picture.known, self._now()
        was_wrong, self._was_wrong = self._was_wrong, known.tone.is_wrong
        if not self._was_wrong:
            if was_wrong:
                self._announced.clear()
                self.announce(texts.NOTICE, known.headline)
            return
        gist = _NUMBER.sub("", known.headline)
        if now - self._announced.get(gist, -REPEATED) >= REPEATED or not was_wrong:
            self.announce(texts.CRITICAL if known.tone is Tone.BAD else texts.WARNING, known.headline)
        self._announced[gist] = now

    def _announce_hands(self, status: ControlStatus) -> None:
        """What the pilot's hands do changes with the phase, and his operator reads it out."""
        if status.hands and status.hands != self._hands_words and status.lease is not None:
            self.announce(texts.NOTICE, f"pilot: {status.hands}")
        self._hands_words = status.hands

    def _send(self, name: str, now: float) -> None:
        """Send a message to every station to which it is due."""
        made: Message | None = None
        for station in self.links.stations:
            if station.is_present(now) and station.is_due(name, now):
                with self.faults.contained(name):
                    made = made or TABLE[name].make(self.picture)
                    if made is not None:
                        station.send(made)
                if made is None:
                    return

    async def _clock(self) -> None:
        while True:
            with self.faults.contained("clock"):
                self.tick()
            with self.faults.contained("missions"):
                self._missions.tick()
            await asyncio.sleep(TICK)

    def tick(self) -> None:
        """Send what the clock sends."""
        now = self.picture.now = self._now()
        for name in BY_CLOCK:
            self._send(name, now)
        mode = self._mode()
        if now - self._beat_at < BEAT and mode is self._beaten:  # QGroundControl waits 1.3 s for a new mode
            return
        self._beat_at, self._beaten = now, mode
        self._announce_verdict()
        reached = self._missions.reached()
        for station in self.links.stations:
            station.send(heartbeat(self.picture, mode, station.numbering))
            if station.is_present(now):
                station.send(self._missions.current())
                for message in reached:
                    station.send(message)

    def _mode(self) -> Mode:
        return mode_now(self.picture, self.steering.shown_mode)

    def announce(self, severity: int, text: str) -> None:
        """Tell all ground stations."""
        for message in self._texts.pieces(severity, text, self._now()):
            for station in self.links.stations:
                if station.is_present(self._now()):
                    station.send(message)

    def notify(self, station: Station, text: str, severity: int = texts.WARNING) -> None:
        """Tell one ground station what becomes of its request."""
        for message in self._texts.pieces(severity, text, self._now(), to=station.name):
            station.send(message)

    def message_arrived(self, station: Station, message: Message) -> None:
        """Take a message of a ground station; one that meets a fault ends there."""
        with self.faults.contained(message.get_type()):
            self._take(station, message)

    def _take(self, station: Station, message: Message) -> None:
        now, name = self._now(), message.get_type()
        program = Program(message.get_srcSystem(), message.get_srcComponent())
        if program.system in (BROADCAST, self._options.system):  # ourselves, or no sender
            return
        if not station.note_message(program, now, is_heartbeat=name == "HEARTBEAT"):
            return
        by = By(station, program)
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            if message.target_system in (BROADCAST, self._options.system):
                self._desk.take(asked_from(by, message))
            return
        target = getattr(message, "target", self._options.system)  # of MANUAL_CONTROL
        if name in self._takes and target == self._options.system and is_for(message, self._options.system, COMPONENT):
            work = self._takes[name](by, message)
            if work is not None:
                self._start(name, work)

    def _set_mode(self, by: By, message: Message) -> None:
        """SET_MODE, which is older than its command: answered as that."""
        params = (float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(message.custom_mode), *[0.0] * 5)
        self._desk.take(Asked(by, int(mavlink.MAV_CMD_DO_SET_MODE), params, None, 0))

    def _start(self, name: str, work: Coroutine[Any, Any, None]) -> None:
        """Work on an answer beside everything else; what is too much is dropped and comes again."""
        if self._tasks is None or len(self._work) >= _MOST_WORK:
            work.close()
            return
        task = self._tasks.create_task(self.faults.contain(name, work), name="answer")
        self._work.add(task)
        task.add_done_callback(self._work.discard)
        task.add_done_callback(lambda _: work.close())  # of one that is cancelled before it has begun
