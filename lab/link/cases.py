"""The cases of `python -m lab link`: the experiments of 2010, and what has to hold today; in virtual time, seeded.

2010 measured echo loss over a cable (0 %) and by radio (1.18 % at 15 Hz, 2.82 % at 50 Hz) under light load and under
full load: echoes, OSD at 100 ms, debug at 200 ms, attitude at 50 ms and external control at 15 to 100 Hz.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from lab.rigs.boardport import TICK_TIME
from lab.rigs.linkrig import Rig, rig
from lab.rigs.sticks import build_sticks
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import ConfigError
from mkdaemon.link.link import Link
from mkdaemon.link.session.traffic import LinkSink, SetpointQueued
from mksim.config import PilotPlan, SimConfig
from mksim.simulation import Simulation

FULL: Final = {"osd": 100.0, "debug": 200.0, "attitude": 50.0}
"""Streams of the full load [ms]."""
RADIO: Final = {
    "to_board": {"kind": "xbee", "loss": 0.01},
    "to_host": {"kind": "xbee", "loss": 0.01, "usb_timer": 0.001},
}
"""The radio of 2010: 13 to 62 ms either way, 1 % of the packets lost in bursts of four."""


@dataclass(frozen=True, slots=True)
class Case:
    """One experiment.

    Attributes:
        name: for `--case`.
        seconds: how long.
        streams: interval by key [ms].
        echo_hz: link tests.
        setpoint_hz: external control; 0 for none.
        sim: what the simulator is configured with.
        settle: discovery and the first streams, and a take-off where there is one, are over by then [s].
    """

    name: str
    seconds: float
    streams: dict[str, float]
    echo_hz: float = 10.0
    setpoint_hz: float = 0.0
    sim: dict[str, Any] = field(default_factory=dict)
    settle: float = 2.5

    @property
    def is_by_radio(self) -> bool:
        """Whether packets are lost on their way."""
        return "radio" in self.sim

    @property
    def is_flown(self) -> bool:
        """Whether the motors run."""
        return "pilot_plan" in self.sim


_NEW: Final = {"board": "nc", "nc": "2.14", "fc": "2.14"}
_OLD: Final = {"board": "nc", "nc": "0.24", "fc": "2.12a"}
_FC: Final = {"board": "fc", "fc": "2.12a"}
_FLOWN: Final = {**_FC, "pilot_plan": "hover", "flight": {"pilot": {"gate": 0}}}
"""The pilot flies with the gate shut: the board confirms stick frames, has less time for the line, and obeys none."""
_FLOWN_STREAMS: Final = {"debug": 200.0, "attitude": 50.0}

CASES: Final = {
    case.name: case
    for case in (
        Case("light", 30, {"osd": 500.0}, sim=_OLD),
        *(Case(f"full_{hz}", 60, FULL, setpoint_hz=hz, sim=_NEW) for hz in (15, 30, 50, 100)),
        *(
            Case(f"fc_{hz}", 60, {"debug": 200.0, "attitude": 50.0}, setpoint_hz=hz, sim=_FC)
            for hz in (15, 30, 50, 100)
        ),
        Case("flown_44", 20, _FLOWN_STREAMS, echo_hz=5.0, setpoint_hz=44, sim=_FLOWN, settle=25.0),
        Case(
            "flown_radio_44",
            20,
            _FLOWN_STREAMS,
            echo_hz=5.0,
            setpoint_hz=44,
            sim={**_FLOWN, "radio": RADIO},
            settle=25.0,
        ),
        Case("saturated", 60, {"osd": 50.0, "debug": 50.0, "attitude": 50.0}, sim=_OLD),
        Case("radio_light", 30, {"osd": 500.0}, sim={**_OLD, "radio": RADIO}),
        *(Case(f"radio_{hz}", 60, FULL, setpoint_hz=hz, sim={**_NEW, "radio": RADIO}) for hz in (15, 50)),
    )
}


FASTEST_SPACED: Final = 60.0
"""More stick frames a second do not keep the gap that a FlightCtrl needs in flight [Hz]."""


def configurations(case: Case) -> tuple[SimConfig, dict[str, Any]]:
    """The simulator of a case, and the link's options."""
    sim = SimConfig.model_validate({"pilot_plan": PilotPlan.NOTHING, "calibrated": True, "connect": (), **case.sim})
    options = {"rates": case.streams, "echo_hz": case.echo_hz, "window": 120.0}
    if case.setpoint_hz:
        options["setpoint_hz"] = max(case.setpoint_hz, LinkConfig().setpoint_hz)
    if case.setpoint_hz > FASTEST_SPACED:
        options["gap_ms"] = 5.0  # at rest nothing is lost so; the experiment of 2010 asks for that rate
    return sim, options


@asynccontextmanager
async def running_link(
    case: Case, boards: Simulation, options: dict[str, Any], sink: LinkSink | None = None
) -> AsyncIterator[Rig]:
    """A link that runs and knows the boards of a case, in the time of the running loop.

    Raises:
        ConfigError: the case steers, and the FlightCtrl's release stays unknown.
    """
    async with rig(lambda: boards, seed=0, sink=sink, tick=TICK_TIME, **options) as running:
        await asyncio.sleep(case.settle)
        for _ in range(100):
            if not case.setpoint_hz or running.link.dialect.extern_control is not None:
                break
            await asyncio.sleep(0.05)
        else:
            reason = running.link.dialect.read_only_reason
            raise ConfigError(f"the simulator's FlightCtrl was not recognised: {reason}")
        yield running


async def steer_steadily(link: Link, case: Case, seconds: float) -> list[float]:
    """Hand in the setpoints of a case for a time [s], or wait where it has none; returns when each was [s]."""
    loop = asyncio.get_running_loop()
    began, handed_in = loop.time(), list[float]()
    layout = link.dialect.extern_control
    for step in range(int(case.setpoint_hz * seconds)):
        assert layout is not None
        await asyncio.sleep(max(0.0, began + step / case.setpoint_hz - loop.time()))
        handed_in.append(loop.time())
        setpoint = build_sticks(layout, pitch=step % 21 - 10)
        fate = link.send_setpoint(setpoint, deadline=loop.time() + 0.1)
        assert isinstance(fate, SetpointQueued)
    await asyncio.sleep(began + seconds - loop.time())
    return handed_in
