"""The simulator on the bus: truth and faults reach clients through the daemon; flight code has no way to the truth."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
import zenoh

from lab.rigs.waiting import wait_for_blocking
from mkdaemon.bus.gateway import Bus
from mkdaemon.stamp import Stamp
from mksim.config import SimConfig
from mksim.programs.sim_bus import sim_on_bus
from mksim.simulation import Simulation
from tests.bus.support import ask, bus_config, client, free_endpoint
from tests.places import SOURCE

STAMP = Stamp(monotonic=1.0, wall=2.0)


@pytest.fixture
def simulation():
    made = Simulation(SimConfig())
    made.advance(0.5)
    return made


async def test_truth_and_faults_reach_a_client_of_the_daemon_and_the_pilot_is_asked(simulation, monkeypatch):
    asked = []
    monkeypatch.setattr(simulation, "start_pilot", lambda: asked.append(True))
    endpoint = free_endpoint()
    async with (
        Bus.open(bus_config(endpoint), "t9"),
        sim_on_bus(simulation, SimConfig(connect=(endpoint,)), "t9"),
    ):
        with client(endpoint) as session:
            ((_, truth, encoding),) = await wait_for_blocking(lambda: ask(session, "mk/t9/sim/truth"))
            assert encoding == "application/msgpack;mk.SimTruth.v1"
            assert truth["t"] == 0.5
            assert truth["age"] >= 0.0
            heard = session.declare_subscriber("mk/t9/sim/*", zenoh.handlers.RingChannel(8))
            request = {"action": "start", "name": "motor_weak", "values": {"motor": 2.0}}
            ((_, answer, _),) = await asyncio.to_thread(ask, session, "mk/t9/sim/fault", request)
            assert answer["status"] == "accepted"
            assert simulation.world.faults.number("motor_weak", "motor") == 2
            samples = [await asyncio.to_thread(heard.handler.recv) for _ in range(3)]
            assert {str(sample.key_expr) for sample in samples} <= {"mk/t9/sim/truth", "mk/t9/sim/faults"}
            ((_, faults, _),) = await wait_for_blocking(
                lambda: [r for r in ask(session, "mk/t9/sim/faults") if "motor_weak" in r[1]["active"]]
            )
            assert faults["active"]["motor_weak"]["values"] == {"motor": 2.0, "share": 0.8}
            ((_, answer, _),) = await asyncio.to_thread(ask, session, "mk/t9/sim/fault", {"name": "mtor_weak"})
            assert (answer["status"], answer["token"]) == ("denied", "unknown_fault")
            ((_, answer, _),) = await asyncio.to_thread(ask, session, "mk/t9/sim/start", {})
            assert (answer["status"], asked) == ("accepted", [True])
            heard.undeclare()


FLIGHT_CODE = ["control", "link", "vision", "daemon", "translate", "protocol", "record"]


@pytest.mark.parametrize("folder", FLIGHT_CODE)
def test_flight_code_names_no_truth(folder):
    """The layers forbid the import; this forbids the key."""
    for path in [*(SOURCE / folder).rglob("*.py"), *SOURCE.glob(f"{folder}.py")]:
        text = path.read_text()
        with contextlib.suppress(ValueError):
            at = text.index("sim/")
            pytest.fail(f"{path} mentions {text[at : at + 20]!r}")
        assert "SimTruth" not in text
