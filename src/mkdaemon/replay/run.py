"""Runs today's daemon on what a recorded one was given: bytes, requests, setpoints, images, each at its time.

Everything between the port and the bus is the daemon's own (`mkdaemon.daemon.wiring`). Zenoh, the guard, cameras and
disks are left out; what they told the recorded daemon is in the recording.
"""

from __future__ import annotations

import asyncio
import tempfile
from bisect import bisect_right
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Final, ParamSpec, TypeVar

from mkdaemon.config.root import Config
from mkdaemon.control.core import FlightCore
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.daemon.procedures import Journal
from mkdaemon.daemon.wiring import Wiring
from mkdaemon.record.entry import Entry, Kind
from mkdaemon.record.notices import Notice
from mkdaemon.record.tap import EYES
from mkdaemon.replay.port import ReplayedLine
from mkdaemon.replay.recorded import Recorded, fields_of
from mkdaemon.replay.script import Moment, Script
from mkdaemon.replay.sight import BlindEyes, ReplayedEyes
from mkdaemon.replay.station import Output, ReplayStation
from mkdaemon.replay.timing import ReplayClock, ReplayLoop
from mkdaemon.virtualtime import end_loop

BEFORE: Final = 1e-6
"""The daemon is put together so long before the first thing that was recorded [s]."""
LEAVING: Final = 2.0
"""Longest time an orderly exit takes [s]."""
_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Replayed:
    """What came out.

    Attributes:
        outputs: everything published and answered, in order.
        has_eyes: whether recorded images were looked at.
    """

    outputs: list[Output]
    has_eyes: bool


def replay(recorded: Recorded, cfg: Config) -> Replayed:
    """Run the recording through today's code.

    Args:
        recorded: what went in.
        cfg: the configuration to fly with.

    Raises:
        ConfigError: the configuration cannot work here: a camera file is not there, for example.
        MkError: a recorded value is not of the form it has today.
    """
    script = Script(recorded.looks, [moment for moment in recorded.moments if came_in(moment.entry)], recorded.backlogs)
    loop = ReplayLoop(script, recorded.start - BEFORE)
    with tempfile.TemporaryDirectory(prefix="mkdaemon-replay-") as folder:
        vehicle = cfg.vehicle.model_copy(update={"state_folder": Path(folder)})
        link = cfg.link.model_copy(update={"label_cache": None})
        try:
            return loop.run_until_complete(
                _Replay(recorded, script, cfg.model_copy(update={"vehicle": vehicle, "link": link}), loop).run()
            )
        finally:
            end_loop(loop)


class _Replay:
    """One run."""

    def __init__(self, recorded: Recorded, script: Script, cfg: Config, loop: ReplayLoop) -> None:
        self._recorded, self._script, self._cfg, self._loop = recorded, script, cfg, loop
        self._offsets = recorded.wall_offsets()
        self._has_eyes = has_every_image(recorded, cfg)
        self._ended = asyncio.Event()

    async def run(self) -> Replayed:
        recorded = self._recorded
        self._station = station = ReplayStation(recorded.replies())
        self._line = ReplayedLine(self._script, recorded.refusals(), self._loop.bring_what_follows)
        self._clock = ReplayClock(self._loop, self._offset)
        self._wiring = wiring = Wiring(
            self._cfg,
            station,
            self._clock,
            make_eyes=self._make_eyes,
            opener=self._line.open,
            journal=Journal(self._cfg.vehicle.state_folder or Path(), AtOnce()),
            first_epoch=recorded.first_epoch(),
        )
        self._loop.follow(self._bring, self._ended.set)
        link = self._loop.create_task(wiring.run_line(), name="link")
        async with asyncio.TaskGroup() as above:
            tasks = wiring.start(above)
            stopped = above.create_task(self._ended.wait(), name="stop")
            await asyncio.wait({stopped, link}, return_when=asyncio.FIRST_COMPLETED)
            outputs = len(station.outputs) if recorded.stopped_at is None else None
            for task in (*tasks, stopped):
                task.cancel()
        link.cancel()
        await asyncio.wait({link}, timeout=LEAVING)
        await station.close()
        return Replayed(station.outputs[:outputs], self._has_eyes)

    def _offset(self, at: float) -> float:
        """Unix time less monotonic time [s], as the recorded daemon knew it at a time [s]."""
        place = bisect_right(self._offsets, at, key=lambda pair: pair[0])
        return self._offsets[max(place - 1, 0)][1] if self._offsets else self._recorded.session.base.offset_ns / 1e9

    def _make_eyes(self, core: FlightCore) -> Eyes:
        if self._has_eyes:
            self._eyes: BlindEyes | ReplayedEyes = ReplayedEyes(
                self._cfg, self._station, core, self._clock, self._recorded
            )
        else:
            self._eyes = BlindEyes(core, self._station, self._clock)
        return self._eyes

    # -- what went in ---------------------------------------------------------------------------------------------

    def _bring(self, moment: Moment) -> None:
        """Let something come in again."""
        entry, line, station = moment.entry, self._line, self._station
        match entry.kind:
            case Kind.PORT_OPENED:
                line.bring_port(str(fields_of(entry).get("port", "")))
            case Kind.PORT_READ:
                line.bring(entry.payload)
            case Kind.PORT_LOST:
                line.lose(str(fields_of(entry).get("reason", "")))
            case Kind.SETPOINT:
                station.bring_setpoint(entry)
            case Kind.QUERY:
                station.bring_query(entry)
            case Kind.SAMPLE:
                self._eyes.bring_seen(entry)
            case Kind.NOTICE:
                self._bring_notice(entry)

    def _bring_notice(self, entry: Entry) -> None:
        fields = fields_of(entry)
        match Notice.of(entry):
            case Notice.CLIENT:
                self._station.bring_client(fields["name"], fields["is_here"])
            case Notice.GUARD_ALIVE:
                self._wiring.guard_changed(fields["is_alive"])
            case Notice.GUARD_ACTED:
                self._wiring.guard_acted(fields["released"])
            case Notice.STOP:
                self._ended.set()


_TAKEN: Final = frozenset({Notice.CLIENT, Notice.GUARD_ALIVE, Notice.GUARD_ACTED, Notice.STOP})
"""What the daemon is told from beside the bus and the line."""


def came_in(entry: Entry) -> bool:
    """Whether this came in from outside; what the eyes saw comes from a thread of its own."""
    match entry.kind:
        case Kind.SAMPLE:
            return entry.suffix.startswith(EYES)
        case Kind.NOTICE:
            return Notice.of(entry) in _TAKEN
        case Kind.REPLY | Kind.PORT_WRITTEN | Kind.IMAGE:
            return False
    return True


class AtOnce(Executor):
    """Does everything at once: a thread would take time that virtual time does not know."""

    def submit(
        self, fn: Callable[_Parameters, _Result], /, *args: _Parameters.args, **kwargs: _Parameters.kwargs
    ) -> Future[_Result]:
        """Do it."""
        future: Future[_Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except OSError as error:
            future.set_exception(error)
        return future


def has_every_image(recorded: Recorded, cfg: Config) -> bool:
    """Whether every image that was looked at is in the recording: a tracker follows from image to image."""
    images = len(recorded.of(Kind.IMAGE))
    looked = {
        moment.entry.suffix: fields_of(moment.entry)["processed"]
        for moment in recorded.of(Kind.SAMPLE)
        if moment.entry.suffix.startswith("vision/") and moment.entry.suffix.endswith("/stats")
    }
    return bool(cfg.cameras) and images > 0 and images >= sum(looked.values())
