"""What happens to a flight of genuine firmware when something fails, judged by the firmware's own memory.

One take-off and hold in virtual time, by a whole daemon with a guard; then the whole world, firmware, air and daemon,
is forked once for each story. What counts is the external control that the FlightCtrl holds in its RAM: from when on no
tilt, from when on not valid.
"""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import Awaitable, Callable, Iterator, Sequence
from functools import partial
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np

from lab import tables
from lab.campaign import Row, carried_out
from lab.control.corerig import pose_of
from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import built
from lab.hil.chip import Held
from lab.hil.flights import Setting, config_of
from lab.hil.processes import in_a_copy
from lab.hil.world import GenuineWorld
from lab.rigs.virtualguard import VirtualGuard
from mkdaemon.control.estimator.values import TargetView
from mkdaemon.control.events import PoseSeen
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.control import ControlStatus, Phase
from mkdaemon.telemetry.setpoint import PositionSetpoint, Setpoint, SetpointFrame, TakeOffSetpoint
from mkdaemon.virtualtime import run_virtually
from mksim.config import WindClass
from mksim.physics.hand_flight import HandFlight
from mksim.programs.virtualdaemon import VirtualDaemon
from mksim.programs.virtualports import Cable, LocalBus

CLIENT: Final = "lab"
HEIGHT: Final = 1.5
IMAGES: Final = 0.05
"""Between two poses [s]."""
IMAGE_AGE: Final = 0.08
"""Of a pose when it arrives [s]."""
NOISE: Final = 0.006
"""Of a pose, each axis [m]."""
STREAM: Final = 0.02
"""Between two setpoints [s]."""
LOOK: Final = 0.004
"""Between two looks at what is waited for [s]."""
LONGEST: Final = 40.0
"""Longest wait for anything [s]."""


class CutCable:
    """The aircraft behind a cable whose daemon may fall silent."""

    def __init__(self, aircraft: GenuineAircraft) -> None:
        self.aircraft, self.now = aircraft, aircraft.now
        self.is_cut = self.is_deaf = False

    def write(self, data: bytes, at: float) -> None:
        """Bytes of the daemon."""
        if not self.is_cut:
            self.aircraft.write(data, at)

    def advance(self, to: float) -> list[tuple[float, bytes]]:
        """Run on."""
        said, self.now = self.aircraft.advance(to), to
        return [] if self.is_deaf else said


class Flight:
    """A client that holds over the target, its daemon, guard, and the aircraft.

    Attributes:
        held: what the firmware held from a time on [s].
        phases: of authority, each with its first moment [s].
        status: newest of the daemon.
        is_streaming: the client streams.
        is_seeing: poses come.
    """

    def __init__(self, firmware: str, seed: int) -> None:
        setting = Setting(firmware, seed)
        aircraft = GenuineAircraft(built(firmware), config_of(setting), voltage=setting.voltage)
        self.loop, self.cable, self.bus = asyncio.get_running_loop(), CutCable(aircraft), LocalBus()
        self.guard = VirtualGuard(lambda data: aircraft.write(data, max(self.loop.time(), aircraft.now)))
        self.daemon = VirtualDaemon(self.bus, Cable(self.cable, self._moved).open, guard=self.guard)
        self.wiring = self.daemon.wiring
        self.world, self._rng = aircraft.world, random.Random(f"{seed} poses")
        self.held: list[tuple[float, Held]] = []
        self.phases: list[tuple[float, Phase]] = []
        self.status: ControlStatus | None = None
        self.is_streaming = self.is_seeing = True
        self.seen_at = self.streamed_at = 0.0
        self.bus.followers.append(self._value_published)
        self.wanted: tuple[type[Setpoint], dict[str, Any]] = (TakeOffSetpoint, {"height": HEIGHT})

    def _moved(self, now: float) -> None:
        held = self.world.held
        if not self.held or self.held[-1][1] != held:
            self.held.append((now, held))

    async def until(self, claim: Callable[[], bool], within: float) -> float | None:
        """Wait for a claim; how long that took [s], None where it never held."""
        began = self.loop.time()
        while not claim():
            if self.loop.time() - began > within:
                return None
            await asyncio.sleep(LOOK)
        return self.loop.time() - began

    def _value_published(self, suffix: str, value: object) -> None:
        if isinstance(value, ControlStatus):
            self.status = value
            if not self.phases or self.phases[-1][1] is not value.phase:
                self.phases.append((self.loop.time(), value.phase))

    async def begin(self) -> None:
        """From the pilot's start of the motors to a hold."""
        self.guard.port_opened(0)
        self.daemon.start()
        self._jobs = [asyncio.create_task(self._see())]
        # the pilot's throttle is still at its lowest then
        link, facts = self.wiring.link, self.wiring.facts

        def is_ready() -> bool:
            is_known = link.is_up and link.dialect.extern_control is not None
            return is_known and bool(facts.motors_running(self.loop.time()))

        await self.until(is_ready, LONGEST)
        await self.bus.take_lease(CLIENT)
        self._jobs.append(asyncio.create_task(self._stream()))
        if await self.until(lambda: self.status is not None and self.status.is_done, LONGEST) is None:
            raise TimeoutError(f"no hold: {self.status}")
        self.wanted = (PositionSetpoint, {"position": (0.0, 0.0, HEIGHT), "frame": SetpointFrame.PAD})
        self.world.change_wind(WindClass.LIGHT)
        await asyncio.sleep(4.0)

    async def _stream(self) -> None:
        while True:
            if self.is_streaming:
                kind, fields = self.wanted
                self.streamed_at = self.loop.time()
                self.bus.deliver(kind, self.streamed_at, *self.bus.sign_next(kind, fields))
            await asyncio.sleep(STREAM)

    async def _see(self) -> None:
        while True:
            truth, at = self.world.truth, self.loop.time()
            noise = np.array([self._rng.gauss(0.0, NOISE) for _ in range(3)])
            rotation = truth.enu_from_flu
            if self.is_seeing and truth.position_enu[2] > 0.25:
                self.seen_at = at
                place = -rotation.T @ (truth.position_enu + noise)
                view = TargetView(at, place, rotation, np.diag([NOISE**2] * 3 + [0.02**2] * 3), "down")
                self.loop.call_later(IMAGE_AGE, self._pose, view)
            await asyncio.sleep(IMAGES)

    def _pose(self, view: TargetView) -> None:
        self.wiring.core.feed(PoseSeen(pose_of(view)), self.loop.time())

    # -- judged by the firmware's memory --------------------------------------------------------------------------

    def level_after(self, since: float) -> float:
        """Time from a moment on to when the firmware holds no tilt any more [s]; infinite for never."""
        return self._ended([held[4] and any(held[:3]) for _, held in self.held], since)

    def released_after(self, since: float) -> float:
        """Time from a moment on to when the firmware holds no valid control any more [s]; infinite for never."""
        return self._ended([held[4] for _, held in self.held], since)

    def _ended(self, claims: list[bool], since: float) -> float:
        after = max((k for k, claim in enumerate(claims) if claim), default=-1) + 1
        return max(0.0, self.held[after][0] - since) if after < len(self.held) else math.inf

    def phase_after(self, phase: Phase, since: float) -> float:
        """Time from a moment on to a phase [s]; infinite for never."""
        return next((at - since for at, found in self.phases if found is phase and at >= since), math.inf)


class SteadyHand(HandFlight):
    """A pilot who leans against the wind: he aims as far beyond his place as he is off it."""

    def __init__(self, world: GenuineWorld) -> None:
        """Begin where the aircraft is."""
        super().__init__(height=HEIGHT, flying=True)
        self._world = world
        self._place = world.truth.position_enu[:2].copy()

    def path(self, t: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where he aims, from his place [m], and how fast that moves [m/s]."""
        del t
        east, north = self._place - self._world.truth.position_enu[:2]
        return (float(east), float(north)), (0.0, 0.0)


TILTED: Final = 4
"""A story begins with at least this tilt asked for [stick]."""
CAPPING: Final = -50
"""The pilot's throttle in the story of the lid [stick]."""


Figures = dict[str, float]


async def client_killed(flight: Flight) -> Figures:
    """Its session ends."""
    since, flight.is_streaming = flight.loop.time(), False
    flight.wiring.flight.client_changed(CLIENT, is_here=False)
    await asyncio.sleep(1.5)
    return {"released": flight.released_after(since)}


async def client_frozen(flight: Flight) -> Figures:
    """It stops to stream."""
    since, flight.is_streaming = flight.streamed_at, False
    await asyncio.sleep(2.0)
    return {"level": flight.level_after(since), "released": flight.released_after(since)}


async def daemon_ends(flight: Flight, how: Callable[[VirtualGuard], None], watched: float) -> Figures:
    """It stands still, its end of the guard's channel open, or it is gone; watched for so long [s]."""
    since = flight.loop.time()
    flight.cable.is_cut = True
    how(flight.guard)
    await asyncio.sleep(watched)
    return {"level": flight.level_after(since), "released": flight.released_after(since)}


async def board_rebooted(flight: Flight) -> Figures:
    """A dip of its supply; obeyed for so long after the boot [s], with motors that stand."""
    since = flight.loop.time()
    flight.world.chip.reset()
    await asyncio.sleep(9.0)
    spans = [
        end - at
        for (at, held), (end, _) in zip(flight.held, flight.held[1:], strict=False)
        if at > since + 0.2 and held[4]
    ]
    lost = min(flight.phase_after(Phase.RELEASING, since), flight.phase_after(Phase.FREE, since))
    return {"lease_ends": lost, "kept_frame_held": sum(spans), "armed": float(flight.world.is_armed)}


async def camera_dead(flight: Flight) -> Figures:
    """No image any more: it looks for the target, inside the fence, until it is released."""
    since, flight.is_seeing = flight.seen_at, False
    await asyncio.sleep(2.8)
    x, y, height = flight.world.truth.position_enu.tolist()
    await asyncio.sleep(1.2)
    searched = {"climbed": height - HEIGHT, "off_cm": 100.0 * math.hypot(x, y)}
    return {**searched, "released": flight.released_after(since)}


async def gate_shut(flight: Flight) -> Figures:
    """The pilot shuts the gate, flies by hand for 5 s, and opens it again."""
    pilot, since = flight.world.pilot, flight.loop.time()
    program = pilot.program
    pilot.program, pilot.gate = SteadyHand(flight.world), 0
    ignored = await flight.until(lambda: not flight.world.is_controlled, 2.0)
    await asyncio.sleep(5.0)
    largest = max(abs(part) for _, held in flight.held[-1:] for part in held[:2])
    unanswered = flight.phase_after(Phase.UNANSWERED, since)
    opened = flight.loop.time()
    pilot.program, pilot.gate = program, 255
    pilot.pitch = pilot.roll = pilot.yaw = 0
    await asyncio.sleep(4.0)
    x, y = flight.world.truth.position_enu[:2]
    flies = flight.status is not None and flight.status.phase is Phase.FLYING
    return {
        "ignored": math.inf if ignored is None else ignored,
        "unanswered": unanswered,
        "sticks_at_opening": float(largest),
        "flies_again": flight.phase_after(Phase.FLYING, opened) if flight.phases[-1][0] > opened else 0.0,
        "flies": float(flies),
        "off_cm": 100.0 * math.hypot(x, y),
    }


async def gate_shut_untold(flight: Flight) -> Figures:
    """The same, where the board tells nothing of its gate: only a tilt that does not follow the sticks shows it."""
    flight.wiring.core.answer.gate_reported = lambda now, *, is_open: None  # type: ignore[method-assign]
    return await gate_shut(flight)


async def lid(flight: Flight) -> Figures:
    """The pilot's throttle is lower than ours; only with the rule of stock firmware."""
    since = flight.loop.time()
    flight.world.pilot.program = None
    flight.world.pilot.gas = CAPPING
    told = await flight.until(lambda: flight.status is not None and flight.status.pilots_throttle is not None, 3.0)
    return {"told": math.inf if told is None else flight.loop.time() - since}


async def receiver_lost(flight: Flight) -> Figures:
    """The pilot's transmitter is gone."""
    since = flight.loop.time()
    flight.world.faults.start("rc_lost", duration=10.0)
    await asyncio.sleep(3.0)
    return {"released": flight.released_after(since)}


async def line_cut(flight: Flight) -> Figures:
    """Nothing reaches the board any more: its own dead-man."""
    since, flight.cable.is_cut, flight.cable.is_deaf = flight.loop.time(), True, True
    await asyncio.sleep(3.0)
    return {"released": flight.released_after(since)}


class Story(NamedTuple):
    """One thing that happens, and least and most of each figure."""

    happens: Callable[[Flight], Awaitable[Figures]]
    goals: dict[str, tuple[float, float]]


AT_OPENING: Final = {"sticks_at_opening": (0.0, 30.0)}
STORIES: Final[dict[str, Story]] = {
    "client_killed": Story(client_killed, {"released": (0.0, 0.35)}),
    "client_frozen": Story(client_frozen, {"level": (0.25, 0.45), "released": (0.9, 1.35)}),
    "daemon_stopped": Story(
        partial(daemon_ends, how=VirtualGuard.daemon_stopped, watched=2.5),
        {"level": (0.2, 0.45), "released": (0.75, 1.15)},
    ),
    "daemon_killed": Story(
        partial(daemon_ends, how=VirtualGuard.daemon_died, watched=2.0), {"level": (0.0, 0.2), "released": (0.0, 0.35)}
    ),
    "board_rebooted": Story(
        board_rebooted, {"lease_ends": (0.0, 1.0), "kept_frame_held": (0.0, 0.3), "armed": (0.0, 0.0)}
    ),
    "camera_dead": Story(  # it rises to `by_target.SEARCH_RISE` times its height meanwhile
        camera_dead, {"climbed": (0.0, 1.5), "off_cm": (0.0, 200.0), "released": (2.8, 3.4)}
    ),
    "gate_shut": Story(
        gate_shut,
        {"ignored": (0.0, 0.2), "unanswered": (0.0, 3.0), **AT_OPENING, "flies_again": (0.0, 3.0), "flies": (1.0, 1.0)},
    ),
    "gate_shut_untold": Story(  # nothing bounds how late it is noticed: docs/safety.md
        gate_shut_untold,
        {"ignored": (0.0, 0.2), **AT_OPENING, "flies": (1.0, 1.0), "off_cm": (0.0, 60.0)},
    ),
    "lid": Story(lid, {"told": (0.4, 1.4)}),
    "receiver_lost": Story(receiver_lost, {"released": (0.0, 1.0)}),
    "line_cut": Story(line_cut, {"released": (1.9, 2.2)}),
}
"""Times from the event to what the firmware holds [s]; docs/safety.md, "What ends a flight"."""


def fire(firmware: str, seed: int) -> dict[str, Row]:
    """Fly once, and let each story happen in a fork; its figures, and which `missed` their goals."""

    async def found() -> dict[str, Row]:
        names = [name for name in STORIES if name != "lid" or firmware.endswith("stock-lid")]
        flight = Flight(firmware, seed)
        try:
            await flight.begin()
        except (TimeoutError, CommandRejectedError) as error:
            return {name: {"missed": [f"the flight did not begin: {error}"]} for name in names}
        silent = {"missed": ["the story ended without a word"]}
        return {name: await in_a_copy(partial(_happen, flight, name, seed)) or silent for name in names}

    return run_virtually(found())


async def _happen(flight: Flight, name: str, seed: int) -> Row:
    """Let a story happen, and judge it."""
    # At another moment of the flight in every story and for every seed, with a tilt to be lost.
    await asyncio.sleep(random.Random(f"{seed} {name}").uniform(0.1, 1.0))
    await flight.until(lambda: max(abs(part) for part in flight.world.held[:2]) >= TILTED, 3.0)
    figures = await STORIES[name].happens(flight)
    return {**figures, "missed": missed(name, figures)}


def by_story(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Every story that happened, with its figures in every flight."""
    for name in STORIES:
        found = [row["stories"][name] for row in rows if name in row["stories"]]
        if found:
            yield name, [{**each, "missed": missed(name, each)} for each in found]


def story_figures(name: str, found: Sequence[Row]) -> Iterator[tuple[str, str, str]]:
    """The figures of a story over all flights: name, least / median / most, goal; a figure that never came counts."""
    for figure in dict.fromkeys(key for each in found for key in each if key != "missed"):
        values = sorted(_value(each, figure) for each in found if figure in each)
        shown = " / ".join("never" if math.isinf(v) else f"{v:.2f}" for v in (values[0], median(values), values[-1]))
        goal = STORIES[name].goals.get(figure)
        yield figure, shown, "" if goal is None else f"{goal[0]:g} to {goal[1]:g}"


def missed(name: str, figures: Row) -> list[str]:
    """Goals of a story that its figures miss; one that never came is none, or infinite, and misses."""
    return [
        f"{figure} {_value(figures, figure):.2f} is not in {least:g} to {most:g}"
        for figure, (least, most) in STORIES[name].goals.items()
        if not least <= _value(figures, figure) <= most
    ]


def _value(figures: Row, figure: str) -> float:
    value = figures.get(figure)
    return math.inf if value is None else float(value)


def show(rows: Sequence[Row], *, as_json: bool) -> int:
    """Print least / median / most of every figure of what happens, and its goal; exit code 1 where one is missed."""
    flown, shown = carried_out(rows), list[Row]()
    for name, found in by_story(flown):
        right = sum(not each["missed"] for each in found)
        figures = {figure: f"{spread}, goal {goal}" for figure, spread, goal in story_figures(name, found)}
        shown.append({"what": name, "right": right, "of": len(found)} | figures | {"holds": right == len(found)})
    if len(flown) < len(rows):
        shown.append({"what": "not flown", "of": len(rows) - len(flown), "holds": False})
    return tables.show(shown, ("what",), as_json=as_json)
