"""The picture and the table of docs/teleop.md: the screen in a flight in virtual time, and the buttons of a pad."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pydantic import BaseModel
from rich.text import Text

from lab.cases import silence_log
from lab.places import CONFIGS
from lab.rigs.cockpit import Boards, cockpit
from lab.rigs.cockpitclient import CockpitClient
from lab.rigs.handpad import HandPad
from mkdaemon.cli.mkctl.teleop.screen import COLUMNS, screen_lines
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.cli.mkctl.teleop.watcher import Watcher
from mkdaemon.client.leasekeeper import LeaseKeeper
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section
from mkdaemon.reading import key_spec
from mkdaemon.telemetry.control import Phase
from mkdaemon.virtualtime import run_virtually
from tools.markdown import table
from tools.screensvg import screen_svg

_SEED: Final = 1
_FLOWN: Final = 1.5
"""How long the picture's flight has lasted [s]."""
_LABELS: Final = {
    "BTN_TL": "LB",
    "ABS_Z+": "LT",
    "BTN_TR": "RB",
    "BTN_SELECT": "Back",
    "BTN_MODE": "Guide",
    "BTN_START": "Start",
    "BTN_Y": "Y",
    "BTN_X": "X",
    "BTN_B": "B",
    "BTN_A": "A",
}
"""What is printed on the pad."""


def screen_picture(_root: Path) -> str:
    """Return the screen of a flight, as SVG."""
    silence_log()
    lines = run_virtually(_flown_screen())
    return screen_svg(lines, COLUMNS)


async def _flown_screen() -> list[Text]:
    watcher = Watcher()

    def follow(key: str, value: BaseModel) -> None:
        spec = key_spec(key)
        if spec is not None and spec.carries is not None:
            watcher.take(key, spec.carries.model_validate(value.model_dump()))

    async with cockpit(Boards("2.12a"), _SEED) as flown:
        for key, value in flown.bus.values.items():
            follow(key, value)
        flown.bus.followers.append(follow)
        session = TeleopSession(LeaseKeeper(CockpitClient(flown, "operator", random.Random(_SEED)).lease))
        stop = asyncio.Event()
        running = asyncio.create_task(session.run(stop))
        pad = HandPad(session, "Xbox pad")
        pad.plug_in()
        await asyncio.sleep(0.1)
        pad.move(ABS_Y=1.0)
        pad.move(ABS_Y=0.0, BTN_TL=1)
        await flown.until(lambda: flown.flight.phase is Phase.FLYING)
        pad.move(ABS_RY=-1.0, ABS_RX=0.7, ABS_Y=-0.6)
        await asyncio.sleep(_FLOWN)
        lines = screen_lines(session, watcher, "mk1 at tcp/127.0.0.1:7447", has_keyboard=False)
        stop.set()
        await running
    return lines


def _mapping(_: None) -> Iterator[str]:
    """The buttons of the Xbox pad, as in its file."""
    given = load_section(Gamepad, CONFIGS / "gamepads" / "xbox.toml").buttons.model_dump()
    rows = ((_LABELS[button], function.replace("_", " ")) for function, button in given.items() if button in _LABELS)
    return table(("button of an Xbox pad", "function"), rows)


TABLES: Final = {"mapping": _mapping}
"""By the name that the page gives it."""
