"""`python -m lab hil --case pair`: a genuine FlightCtrl behind a genuine NaviCtrl, the daemon in front of both.

The boards are joined as on an aircraft, by their bus and the UART between them; the heading comes from the NaviCtrl's
compass. Take-off, a hold in indoor air and a landing, with the rendered camera of `lab.hil.flights`: attitudes,
telemetry and sticks cross both boards.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence
from typing import Any, Final

from lab import tables
from lab.campaign import Row
from lab.hil.aircraft import GenuineAircraft
from lab.hil.build import Firmware, built, built_navictrl
from lab.hil.flights import Leg, SceneFlight, Setting, config_of
from lab.hil.naviboard import NaviBoard, Socket, Surroundings
from lab.hil.world import GenuineWorld
from mkdaemon.virtualtime import run_virtually
from mksim.config import SimConfig
from mksim.physics.world import StartState
from mksim.programs.rehearsal import land, over_pad, take_off
from mksim.scene.camera import deck_of

VOLTAGE: Final = 15.6
BOOTED: Final = 10.0
"""Both boards need so long to find each other, compass and GPS receiver [s]."""
START: Final = 14.0
"""When the pilot starts the motors [s]: a FlightCtrl behind a NaviCtrl is asked for its release before."""
LEG: Final = Leg((take_off(), over_pad("hold", 0.0, 20.0), land()))
FIGURES: Final = ("hold_cm", "touch_cm", "nees_level")
"""Of a flight; see `lab.hil.flights.figures`."""


class PairWorld(GenuineWorld):
    """The world around both boards.

    Attributes:
        navi: the NaviCtrl.
    """

    def join(self, navi: NaviBoard) -> None:
        """Put the NaviCtrl on the FlightCtrl's bus and UART."""
        self.navi = navi
        self._surroundings = Surroundings(self)
        self.chip.connect(navi.exchange_address)

    def _run_chip(self, until: float) -> None:
        """Run the FlightCtrl, which takes the NaviCtrl along with every byte on their bus; then that one, too."""
        super()._run_chip(until)
        navi = self.navi
        begun = navi.now
        navi.receive(Socket.FLIGHTCTRL, ((max(at, begun), byte) for at, byte in self.chip.read()))
        self._surroundings.tend(navi, begun)
        navi.run(until)
        self.chip.inbox.extend(navi.read(Socket.FLIGHTCTRL))


class NaviPair(GenuineAircraft):
    """One aircraft, and the far end of the NaviCtrl's serial line."""

    world: PairWorld
    _world_class = PairWorld

    def __init__(self, flight: Firmware, config: SimConfig, **more: Any) -> None:
        """Switch both boards on; `more` is start, ground and voltage, see `GenuineAircraft`.

        Raises:
            ConfigError: no NaviCtrl is built, or this process has run one already.
        """
        super().__init__(flight, config, has_compass=False, **more)
        self.world.join(NaviBoard(built_navictrl()))

    def _receive(self, arrivals: Iterable[tuple[float, int]]) -> None:
        navi = self.world.navi
        navi.receive(Socket.HOST, ((max(at, navi.now), byte) for at, byte in arrivals))

    def _read(self) -> list[tuple[float, int]]:
        self.world.navi.read(Socket.COMPASS)
        return self.world.navi.read(Socket.HOST)


def fly(firmware: str, seed: int) -> Row:
    """Fly once over the target; a process does it once, for it has one NaviCtrl. See `lab.hil.flights.figures`.

    Raises:
        ConfigError: something is not built.
    """

    async def found() -> Row:
        setting = Setting(firmware, seed, voltage=VOLTAGE)
        config = config_of(setting).model_copy(update={"pilot_wait": START})
        start, ground = StartState(yaw=setting.yaw), deck_of(config.scene.platform)
        more: Row = {"start": start, "ground": ground, "voltage": VOLTAGE}
        pair = NaviPair(built(firmware), config, **more)
        await asyncio.sleep(BOOTED)
        pair.advance(BOOTED)
        flight = SceneFlight(config, pair, (LEG,))
        await flight.fly()
        return flight.found

    return run_virtually(found())


def show(rows: Sequence[Row], *, as_json: bool) -> int:
    """Print the figures of every flight; exit code 1 where one is lost."""
    shown = list[Row]()
    for row in rows:
        lost = row.get("lost", [row.get("why")])
        figures: Row = {key: row[key] for key in FIGURES if key in row}
        shown.append({"seed": row["seed"], **figures, "lost": lost, "holds": not lost})
    return tables.show(shown, ("seed",), as_json=as_json)
