"""Situations for the tests of admission: `GOOD`, in which everything may begin, and what is put in its place."""

from __future__ import annotations

from dataclasses import replace

from mkdaemon.config.control import ControlConfig
from mkdaemon.control.activeset import Gate, GateKind, KnownSet
from mkdaemon.control.admission.situation import NO_WORK, EntryEstimate, Situation
from mkdaemon.control.motionmatch import Match
from mkdaemon.telemetry.control import ControlLine, Phase
from mkdaemon.telemetry.link import LinkHealth, RoundTripStats
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.telemetry.state import Battery, Flight, Gps, Pilot, Position
from mkdaemon.telemetry.vision import EyeState, VisionStats
from tests.control.events import STAMP, flight, link_state, pilot

SET = KnownSet(Gate(GateKind.CHANNEL, 255), "Easy", emergency_throttle=110, emergency_time=90, low_cell=3.2)

SHARED = Gate(GateKind.CHANNEL, 255, altitude_channel=5)


def health(*, lost=0, sent=50):
    echo = RoundTripStats(sent=sent, lost=lost, loss_percent=100.0 * lost / sent if sent else 0.0)
    return LinkHealth(stamp=STAMP, state=link_state(), echo=echo, confirm=RoundTripStats())


def battery(voltage, *, is_low=None):
    return Battery(stamp=STAMP, source="nc/osd", voltage=voltage, current=None, used_mah=None, is_low=is_low)


def heights(share=0.0, *, sd=5.0, covered=1.5, odds=-1.0):
    """What a camera found out about its heights by the barometer [%; m]."""
    found = {"height_percent": share, "height_sd_percent": sd, "height_covered": covered, "height_odds": odds}
    return SelfCalibration.model_construct(target="pad", **found)


def eyes(state=EyeState.OK, alarms=None, reason="", **more):
    fields = {"state": state, "alarms": alarms or {}, "reason": reason, "processed": 9, "latency_p50_ms": 80.0}
    fields["selfcal"] = (heights(),)
    return VisionStats.model_construct(stamp=STAMP, camera="down", **(fields | more))


def reception(quality):
    return Pilot.model_copy(pilot(0.0), update={"rc_quality": quality})


def flags(**flags):
    return Flight.model_copy(flight(is_flying=None), update=flags)


ENTRY = EntryEstimate(target="pad", age=0.1, speed=0.1, offset=0.1, height=2.0, sd=0.02, clean=3.0)
GOOD = Situation(
    cfg=ControlConfig(),
    now=1.0,
    phase=Phase.FREE,
    holder="",
    lease_left=0.0,
    flown=None,
    work=NO_WORK,
    line=ControlLine("v2"),
    has_guard=True,
    link=link_state(),
    health=health(),
    active_set=SET,
    motors_running=True,
    is_testing_motors=False,
    flight=flight(is_flying=None),
    pilot=pilot(0.0),
    position=None,
    gps=None,
    battery=battery(16.0),
    cells=4,
    are_cells_doubtful=False,
    is_touching=False,
    unanswered="",
    hover_gas=125.0,
    gas_in_use=None,
    eyes=(eyes(),),
    contradicting=(),
    target_age=0.1,
    paths=frozenset({"p1"}),
    in_sight=("pad",),
    entry=ENTRY,
    stamps=Match(0.01, 0.95),
    free_disk=5e9,
    model=None,
    loop=None,
)


BLIND = {"entry": None}
"""What changes where there is no estimate."""


def sees(**change):
    """What changes where the estimate says something else."""
    return {"entry": replace(ENTRY, **change)}


def situation_of(facts, now, phase=Phase.FREE):
    """What is known of a vehicle at a time [s], where all else is well."""
    return replace(
        GOOD,
        now=now,
        phase=phase,
        link=facts.link,
        motors_running=facts.motors_running(now),
        is_testing_motors=facts.is_testing_motors(now),
        flight=facts.newest(Flight, now),
        position=facts.newest(Position, now),
        gps=facts.newest(Gps, now),
        pilot=facts.newest(Pilot, now),
        battery=facts.newest(Battery, now),
        cells=facts.cells,
    )
