"""The pictures of docs/teleop.md: the live screen in a flight in virtual time, and what the controls of a pad do."""

from __future__ import annotations

import asyncio
import random
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
from mkdaemon.client.teleop.shaping import MODES
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section
from mkdaemon.reading import key_spec
from mkdaemon.telemetry.control import Phase
from mkdaemon.virtualtime import run_virtually
from tools.screensvg import screen_svg, svg_of, svg_text

_SEED: Final = 1
_FLOWN: Final = 1.5
"""How long the picture's flight has lasted [s]."""
_WORDS: Final = {
    "pitch": "pitch: forward, back",
    "roll": "roll: to the sides",
    "yaw": "yaw: turn",
    "throttle": "thrust: up, down",
}
_PLACES: Final = {
    "BTN_TL": (20, 60, "LB"),
    "ABS_Z+": (20, 20, "LT"),
    "BTN_TR": (860, 60, "RB"),
    "BTN_SELECT": (20, 120, "Back"),
    "BTN_MODE": (20, 160, "Guide"),
    "BTN_START": (860, 290, "Start"),
    "BTN_Y": (860, 120, "Y"),
    "BTN_X": (860, 160, "X"),
    "BTN_B": (860, 200, "B"),
    "BTN_A": (860, 240, "A"),
}
"""Where the label of a button stands, and what is printed on the pad."""
_MEANINGS: Final = {
    "enable": "enable button: hold it to fly",
    "fine": "fine, on and off",
    "thrust_lock": "thrust lock, on and off",
    "recentre": "re-centre hover thrust",
    "reset": "reset trims, fine, lock, hover",
    "takeoff": "take-off (half a second)",
    "hold": "hold the place",
    "land": "land (half a second)",
    "release": "RELEASE, at once",
    "stop": "stop the motors (one second)",
}


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


def mapping_picture(_root: Path) -> str:
    """Return what the controls of the Xbox pad do, stick mode as in its file, as SVG."""
    pad = load_section(Gamepad, CONFIGS / "gamepads" / "xbox.toml")
    parts = [
        '<rect width="1150" height="425" fill="#ffffff"/>',
        '<g transform="translate(165,0)">',
        '<path d="M 330 110 h 240 q 60 0 80 70 l 25 130 q 5 60 -50 50 q -40 -10 -65 -75 h -220 q -25 65 -65 75 '
        'q -55 10 -50 -50 l 25 -130 q 20 -70 80 -70 z" fill="#f2f2f2" stroke="#555555" stroke-width="2"/>',
    ]
    for x, y, side in ((350, 180, "left"), (520, 255, "right")):
        parts.append(f'<circle cx="{x}" cy="{y}" r="30" fill="#cfcfcf" stroke="#555555"/>')
        stick = {place: function for function, place in MODES[pad.mode].items()}
        words = f"{_WORDS[stick[f'{side}_y']]}; {_WORDS[stick[f'{side}_x']]}"
        parts.append(svg_text(x, y + 5, side, "#222222", anchor="middle"))
        at = (245, 395) if side == "left" else (545, 395)
        parts.append(svg_text(at[0] - 145, at[1], f"{side} stick:", "#222222", bold=True))
        parts.append(svg_text(at[0] - 145, at[1] + 18, words, "#222222"))
    parts.append(
        '<path d="M 400 235 h 14 v 14 h 14 v 14 h -14 v 14 h -14 v -14 h -14 v -14 h 14 z" fill="#cfcfcf" '
        'stroke="#555555"/>'
    )
    parts.append(svg_text(407, 295, "d-pad: trims", "#222222", anchor="middle"))
    for x, y, label in ((585, 150, "Y"), (560, 175, "X"), (610, 175, "B"), (585, 200, "A")):
        parts.append(f'<circle cx="{x}" cy="{y}" r="11" fill="#ffffff" stroke="#555555"/>')
        parts.append(svg_text(x, y + 5, label, "#222222", anchor="middle"))
    parts.append("</g>")
    given = pad.buttons.model_dump()
    for function, meaning in _MEANINGS.items():
        x, y, label = _PLACES[given[function]]
        colour = "#b00020" if function in {"enable", "release"} else "#222222"
        parts.append(svg_text(x, y, f"{label:5} {meaning}", colour, bold=function in {"enable", "release"}))
    return svg_of(1150, 425, parts)
