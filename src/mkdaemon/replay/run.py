"""Runs today's daemon on what a recorded one was given: bytes, requests, setpoints, images, each at its time.

Everything between the port and the bus is the daemon's own (`mkdaemon.daemon.wiring`). Zenoh, the guard, cameras and
disks are left out; what they told the recorded daemon is in the recording.
"""

from __future__ import annotations

import asyncio
import tempfile
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import msgpack

from mkdaemon.clock import Wake
from mkdaemon.config.root import Config
from mkdaemon.control.core import FlightCore
from mkdaemon.daemon.eyes import Eyes
from mkdaemon.daemon.procedures import Journal
from mkdaemon.daemon.wiring import Wiring
from mkdaemon.record.entry import Kind
from mkdaemon.record.notices import Notice
from mkdaemon.replay.port import ReplayedLine
from mkdaemon.replay.recorded import SOON, Moment, Recorded
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
    """
    loop = ReplayLoop(recorded.timetable(), recorded.start - BEFORE)
    with tempfile.TemporaryDirectory(prefix="mkdaemon-replay-") as folder:
        vehicle = cfg.vehicle.model_copy(update={"state_folder": Path(folder)})
        link = cfg.link.model_copy(update={"label_cache": None})
        try:
            return loop.run_until_complete(
                _Replay(recorded, cfg.model_copy(update={"vehicle": vehicle, "link": link}), loop).run()
            )
        finally:
            end_loop(loop)


class _Replay:
    """One run."""

    def __init__(self, recorded: Recorded, cfg: Config, loop: ReplayLoop) -> None:
        self._recorded, self._cfg, self._loop = recorded, cfg, loop
        self._offsets = recorded.wall_offsets()
        self._has_eyes = has_every_image(recorded, cfg)

    async def run(self) -> Replayed:
        recorded = self._recorded
        self._station = station = ReplayStation(recorded.replies())
        self._line = ReplayedLine(recorded.openings(), recorded.refusals())
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
        self._bring_everything()
        ended = asyncio.Event()
        self._loop.happens_at(recorded.stopped_at or recorded.end, ended.set)
        link = self._loop.create_task(wiring.link.run(), name="link")
        async with asyncio.TaskGroup() as above:
            tasks = wiring.start(above)
            stopped = above.create_task(ended.wait(), name="stop")
            await asyncio.wait({stopped, link}, return_when=asyncio.FIRST_COMPLETED)
            outputs = len(station.outputs) if recorded.stopped_at is None else None
            for task in (*tasks, stopped):
                task.cancel()
        link.cancel()
        await asyncio.wait({link}, timeout=LEAVING)
        await station.close()
        return Replayed(station.outputs[:outputs], self._has_eyes)

    def _offset(self) -> float:
        """Unix time less monotonic time [s], as the recorded daemon knew it now."""
        place = bisect_right(self._offsets, self._loop.time(), key=lambda pair: pair[0])
        return self._offsets[max(place - 1, 0)][1] if self._offsets else self._recorded.session.base.offset_ns / 1e9

    def _make_eyes(self, core: FlightCore) -> Eyes:
        if not self._has_eyes:
            self._eyes: BlindEyes | ReplayedEyes = BlindEyes(core)
        else:
            published_at = {(camera, number): at for camera, number, at in _seen(self._recorded)}
            self._eyes = ReplayedEyes(self._cfg, self._station, core, self._clock, self._loop, published_at)
        return self._eyes

    # -- what went in ---------------------------------------------------------------------------------------------

    def _bring_everything(self) -> None:
        """Set everything that went in on its time."""
        wakes = self._recorded.wakes(Wake.CONTROL)
        for moment in self._recorded.moments:
            bring = self._bringer(moment)
            if bring is not None:
                at = _decided_at(moment, wakes) if moment.entry.kind is Kind.SETPOINT else moment.at
                self._loop.happens_at(at, bring)

    def _bringer(self, moment: Moment) -> Callable[[], None] | None:
        """What brings an entry; None for what came out."""
        entry, eyes = moment.entry, self._eyes
        match entry.kind:
            case Kind.PORT_READ:
                return partial(self._line.bring, entry.payload)
            case Kind.PORT_LOST:
                return partial(self._line.lose, str(msgpack.unpackb(entry.payload).get("reason", "")))
            case Kind.SETPOINT:
                return partial(self._station.bring_setpoint, entry)
            case Kind.QUERY:
                return partial(self._station.bring_query, entry)
            case Kind.NOTICE:
                return self._notice_bringer(moment)
            case Kind.IMAGE if isinstance(eyes, ReplayedEyes):
                return partial(eyes.bring_image, entry)
            case Kind.SAMPLE if entry.suffix.startswith("vision/"):
                _, camera, what = entry.suffix.split("/", 2)
                if isinstance(eyes, ReplayedEyes) and what == "stats":
                    return partial(eyes.bring_mount, camera)
                if isinstance(eyes, BlindEyes) and what == "pose":
                    return partial(eyes.bring_pose, entry)
        return None

    def _notice_bringer(self, moment: Moment) -> Callable[[], None] | None:
        payload = moment.entry.payload
        fields: dict[str, Any] = msgpack.unpackb(payload) if payload else {}
        match Notice.of(moment.entry):
            case Notice.CLIENT:
                return partial(self._station.bring_client, fields["name"], fields["is_here"])
            case Notice.GUARD_ALIVE:
                return partial(self._wiring.flight.guard_changed, fields["is_alive"])
            case Notice.GUARD_ACTED:
                return partial(self._wiring.flight.guard_acted, fields["released"])
        return None


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


def _decided_at(moment: Moment, wakes: list[float]) -> float:
    """When the flight core took a setpoint [s]: it came to the loop a little later than it arrived."""
    place = bisect_left(wakes, moment.at)
    return wakes[place] if place < len(wakes) and wakes[place] - moment.at <= SOON else moment.at


def _seen(recorded: Recorded) -> list[tuple[str, int, float]]:
    """What was seen in images: camera, number of the image, when it was published [s]."""
    found = []
    for moment in recorded.of(Kind.SAMPLE):
        parts = moment.entry.suffix.split("/")
        if parts[0] == "vision" and parts[-1] in {"tags", "pose"}:
            found.append((parts[1], int(msgpack.unpackb(moment.entry.payload)["sequence"]), moment.at))
    return found


def has_every_image(recorded: Recorded, cfg: Config) -> bool:
    """Whether every image that was looked at is in the recording: a tracker follows from image to image."""
    images = len(recorded.of(Kind.IMAGE))
    looked = {
        moment.entry.suffix: msgpack.unpackb(moment.entry.payload)["processed"]
        for moment in recorded.of(Kind.SAMPLE)
        if moment.entry.suffix.startswith("vision/") and moment.entry.suffix.endswith("/stats")
    }
    return bool(cfg.cameras) and images > 0 and images >= sum(looked.values())
