"""The path of a setpoint from Zenoh's thread to the line is the one that docs/architecture.md shows."""

from __future__ import annotations

import asyncio
import re
import sys

from lab.rigs.cockpit import Boards, cockpit
from mkdaemon.bus.codec import encode_map
from mkdaemon.bus.intake import SetpointIntake
from mkdaemon.bus.recording import recorded_taker
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.signature import sign
from mkdaemon.virtualtime import run_virtually
from tests.places import DOCS

NEUTRAL = {"ttl": 0.3, "pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 10.0}
ROW = re.compile(r"^\| \d+ \| `(\S+) (\S+)` \|", re.MULTILINE)


class NoRecorder:
    """Records nothing."""

    def setpoint(self, *args, **more): ...

    def setpoint_refused(self, *args): ...


def shown_walk():
    """Module and function of every line of the table."""
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    return [(f"mkdaemon.{module}", name) for module, name in ROW.findall(page.partition("## Recipes")[0])]


async def calls_of_one_setpoint():
    """Every call in the daemon while one setpoint of a stream goes from the intake to the line."""
    calls = []

    def note(frame, event, _):
        module = frame.f_globals.get("__name__", "")
        if event == "call" and module.startswith("mkdaemon."):
            calls.append((module, frame.f_code.co_qualname.replace("recorded_taker.<locals>.", "")))

    async with cockpit(Boards("2.12a"), 1) as flown:
        await flown.take("alice")
        take, verify = flown.bus.takers["setpoint/stick"]
        loop = asyncio.get_running_loop()
        taken = recorded_taker(NoRecorder(), "setpoint/stick", "", take)
        intake = SetpointIntake(loop, lambda one: taken(one._replace(at=loop.time())), verify, lambda: None, loop.time)
        for sequence in range(1, 121):
            payload = encode_map({"epoch": flown.epoch, "sequence": sequence, **NEUTRAL})
            proof = sign(flown.secret, "setpoint/stick", payload)
            sys.setprofile(note if sequence == 120 else None)
            try:
                intake.arrived(payload, proof)
                await asyncio.sleep(0.02)
            finally:
                sys.setprofile(None)
        assert flown.flight.phase is Phase.FLYING
    return calls


def test_a_setpoint_goes_the_way_that_is_shown_and_its_signature_is_computed_once():
    calls = run_virtually(calls_of_one_setpoint())
    walk = shown_walk()
    assert len(walk) == 11
    assert [call for call in dict.fromkeys(calls) if call in walk] == walk
    assert calls.count(("mkdaemon.telemetry.signature", "sign")) == 1
