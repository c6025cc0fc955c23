"""`python -m lab hil --case navictrl`: a genuine NaviCtrl and the simulator's, side by side; what differs, and why.

Four pieces of work, each in a process of its own: the script of bytes and the daemon's own code, on either board.
Replies to the same bytes, their number, times and fields are compared.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, Protocol

from lab.campaign import Row, in_order
from lab.hil.build import built_navictrl
from lab.hil.chip import Held
from lab.hil.naviaircraft import NaviAircraft
from lab.hil.navidaemon import DaemonAtNavi
from lab.hil.naviscript import FLIGHT, GROUND, LAST, Answers, Item, listen
from lab.hil.processes import be_quiet
from lab.tables import show as show_rows
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.framing import Frame
from mkdaemon.virtualtime import run_virtually
from mksim.boards.flightctrl import FlightCtrl
from mksim.config import GasLaw, PilotPlan, SimConfig
from mksim.physics.hand_flight import HandFlight
from mksim.programs.rehearsal import FlyingAircraft
from mksim.simulation import Simulation

TOLERANCE: Final = {
    **dict.fromkeys(("position_longitude", "position_latitude"), 200),
    **dict.fromkeys(("home_longitude", "home_latitude", "target_longitude", "target_latitude"), 250),
    **dict.fromkeys(("position_altitude", "home_altitude", "target_altitude"), 3000),
    **dict.fromkeys(("ground_speed", "vertical_speed"), 60),
    **dict.fromkeys(("flying_time", "battery", "target_hold_time", "satellites"), 1),
    **dict.fromkeys(("pitch", "roll"), 4),
    "altitude_setpoint": 400,
    "home_distance": 25,
    "target_distance": 15,
    "altimeter": 30,
    "variometer": 6,
    "throttle": 12,
    "current": 25,
    "used_capacity": 5,
}
"""How far two noisy boards may be apart before a field counts as different; what is not here must be equal."""
ANALOG: Final = {0: 40, 1: 40, 2: 80, 3: 80, 9: 40, 10: 360, 13: 8, 15: 400, 21: 80, 22: 80, 27: 300, 28: 300}
"""The same of the channels of debug data."""
TURNS: Final = {"heading": (360, 8), "course": (360, 360), "home_bearing": (360, 360), "target_bearing": (360, 360)}
"""Angles: a whole turn, and how far they may be apart; a course of an aircraft at rest is anything."""
OWN_WORDS: Final = {"text"}
"""Labels, menus and error texts of the simulator are its own."""
SOONER: Final = 2.5e-3
"""First replies further apart than this are told [s]."""


def differences(genuine: Answers, simulated: Answers) -> Iterator[str]:
    """What the simulated board does otherwise, in words."""
    ours, theirs = simulated.kinds, genuine.kinds
    for kind in sorted(ours.keys() | theirs.keys()):
        few, many = len(ours.get(kind, ())), len(theirs.get(kind, ()))
        if abs(few - many) > (1 if many > 5 else 0):
            yield f"{kind}: {many} frames, simulated {few}"
    if genuine.frames and simulated.frames:
        first, other = genuine.frames[0][0], simulated.frames[0][0]
        if abs(other - first) > SOONER:
            yield f"first reply after {first * 1e3:.1f} ms, simulated {other * 1e3:.1f}"
    for kind in sorted(ours.keys() & theirs.keys()):
        yield from (f"{kind}.{words}" for words in _fields(theirs[kind][-1], ours[kind][-1]))
    if bool(genuine.text) != bool(simulated.text):
        texts = (repr(text.decode("latin-1")) if text else "none" for text in (genuine.text, simulated.text))
        yield "text {}, simulated {}".format(*texts)
    if genuine.held != simulated.held:
        yield f"the FlightCtrl holds {genuine.held}, simulated {simulated.held}"


def _fields(genuine: Frame, simulated: Frame) -> Iterator[str]:
    """Fields of two frames of one kind that differ."""
    decoder = MessageDecoder()
    left, right = decoder.decode(genuine), decoder.decode(simulated)
    if isinstance(left, Unknown) or isinstance(right, Unknown) or type(left) is not type(right):
        if genuine.payload != simulated.payload:
            yield f"payload {genuine.payload.hex()}, simulated {simulated.payload.hex()}"
        return
    for name in type(left).model_fields:
        one, other = getattr(left, name), getattr(right, name)
        if name in OWN_WORDS or one == other or _is_near(name, one, other):
            continue
        if isinstance(one, tuple):
            pairs = enumerate(zip(one, other, strict=True))
            places = [k for k, (a, b) in pairs if abs(a - b) > (ANALOG.get(k, 0) if name == "analog" else 0)]
            if not places:
                continue
            yield f"{name}{places} {[one[k] for k in places]}, simulated {[other[k] for k in places]}"
        else:
            yield f"{name} {one!s}, simulated {other!s}"


def _is_near(name: str, one: object, other: object) -> bool:
    if not isinstance(one, int) or not isinstance(other, int):
        return False
    if name in TURNS:
        turn, allowed = TURNS[name]
        away = abs(one - other) % turn
        return min(away, turn - away) <= allowed
    return abs(one - other) <= TOLERANCE.get(name, 0)


BOOTED: Final = 8.0
"""Genuine boards need so long to start [s]; the simulator's wait as long."""
HOVERING: Final = 15.0
"""From the pilot's start to a steady hover [s]."""
STEP: Final = 0.01
KNOWN: Final[Mapping[str, str]] = {
    "nD.analog[4]": "the fork's own GPS code leaves the channel OperatingRadius alone",
    "text '\\n Timer2 deinit...": "the simulator's GPS receiver has no UART: nothing comes through to the host",
}
"""Beginnings of differences that are no fault, and why."""
CLOSE: Final = 0.06
"""Times of the daemon's steps may differ so much [s], or by a quarter: the boards' clocks are not in phase."""
STREAMS: Final = 0.07
"""One frame each of OSD data, debug data, attitude and display, at 57600 baud [s]. A version reply leaves after all of
them that are due (UART1_TransmitTxData of uart1.c), and whether they are depends on when the daemon subscribed last."""
BEHIND_STREAMS: Final = ("NaviCtrl after it",)
"""Steps that wait for such a reply while streams are being renewed."""
SCRIPT: Final = (*GROUND, *FLIGHT, *LAST)
"""Everything the host does."""


class Boards(FlyingAircraft, Protocol):
    """What both kinds of aircraft have."""

    @property
    def flight(self) -> FlightCtrl:
        """The simulated FlightCtrl."""


def show(seed: int, jobs: int, *, as_json: bool) -> int:
    """Compare, and show what differs; exit code 1 where something differs that is not known.

    Raises:
        ConfigError: no NaviCtrl is built.
    """
    release = built_navictrl().release
    work = [(kind, is_genuine, seed) for kind in ("bytes", "daemon") for is_genuine in (True, False)]
    genuine, simulated, steps, simulated_steps = in_order(_do, work, jobs, is_alone=True)
    shown: list[Row] = []
    for item, *pair in zip(SCRIPT, genuine, simulated, strict=True):
        found = list(differences(*pair))
        shown.append({"what": item.name, "differs": found, "holds": not unknown(found)})
    for one, other in zip(steps, simulated_steps, strict=False):
        times = {"genuine": [one["ended"], one["figure"]], "simulated": [other["ended"], other["figure"]]}
        shown.append({"what": one["what"], **times, "holds": agree(one, other)})
    shown.append({"what": "the daemon's steps", "holds": len(steps) == len(simulated_steps)})
    return show_rows(shown, ("what",), as_json=as_json, release=release)


def unknown(found: Sequence[str]) -> list[str]:
    """Differences that are not known."""
    return [words for words in found if not any(words.startswith(known) for known in KNOWN)]


def agree(genuine: Row, simulated: Row) -> bool:
    """Whether a step of the daemon ended alike, and took about as long."""
    (what, ended, one), other = (genuine[name] for name in ("what", "ended", "figure")), simulated["figure"]
    if (what, ended) != (simulated["what"], simulated["ended"]) or None in (one, other):
        return genuine == simulated
    close = STREAMS if what in BEHIND_STREAMS else CLOSE
    return bool(abs(one - other) <= max(close, 0.25 * abs(one)))


def _do(work: tuple[str, bool, int]) -> list[Any]:
    be_quiet()
    kind, is_genuine, seed = work
    config = SimConfig(seed=seed, pilot_plan=PilotPlan.NOTHING, fc="early", gas_law=GasLaw.FORK)

    def boards() -> Boards:
        return NaviAircraft(built_navictrl(), config) if is_genuine else Simulation(config)

    return _listen(boards()) if kind == "bytes" else run_virtually(_run_daemon(boards))


def _listen(boards: Boards) -> list[Answers]:
    """What the boards answer to the script."""

    def wait(seconds: float) -> None:
        until = boards.now + seconds
        while boards.now < until:
            boards.advance(boards.now + STEP)

    def listened(items: Sequence[Item]) -> list[Answers]:
        return [listen(boards, item, lambda: str(boards.flight.external.held)) for item in items]

    wait(BOOTED)
    found = listened(GROUND)
    boards.world.pilot.program = HandFlight()
    wait(HOVERING)
    return found + listened((*FLIGHT, *LAST))


async def _run_daemon(make: Callable[[], Boards]) -> list[Row]:
    boards = make()
    await asyncio.sleep(BOOTED)
    boards.advance(BOOTED)
    external = boards.flight.external

    def held() -> Held:
        now = external.held
        return now.pitch, now.roll, now.yaw, now.throttle, external.is_valid

    return await DaemonAtNavi(boards, held).run()
