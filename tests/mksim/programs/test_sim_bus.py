"""The simulator on the bus: truth and faults reach clients through the daemon; flight code has no way to the truth."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
import zenoh

from lab.rigs.waiting import wait_for_blocking
from mkdaemon.bus.gateway import Bus
from mkdaemon.errors import ConfigError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.sim import FaultRequest, SimFaults
from mksim.config import SimConfig
from mksim.programs.sim_bus import apply_fault_request, sim_on_bus, truth_of
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


async def test_without_a_daemon_the_simulator_waits_and_joins_later(simulation):
    endpoint = free_endpoint()
    async with sim_on_bus(simulation, SimConfig(connect=(endpoint,)), "t9"):
        await asyncio.sleep(0.7)
        async with Bus.open(bus_config(endpoint), "t9"):
            with client(endpoint) as session:
                assert await wait_for_blocking(lambda: ask(session, "mk/t9/sim/truth"))


async def test_an_endpoint_nobody_can_understand_is_said_at_once(simulation):
    with pytest.raises(ConfigError, match=r"sim\.connect 'garbage'"):
        async with sim_on_bus(simulation, SimConfig(connect=("garbage",)), "t9"):
            pytest.fail("connected")


async def test_leaving_at_once_closes_everything(simulation):
    for pause in (0.0, 0.05):
        async with sim_on_bus(simulation, SimConfig(connect=(free_endpoint(),)), "t9"):
            await asyncio.sleep(pause)


@pytest.mark.parametrize(
    ("fields", "running"),
    [
        ({"action": "start", "name": "rc_lost"}, {"rc_lost"}),
        ({"action": "start", "name": "link_cut", "values": {"direction": "to_host"}}, {"link_cut"}),
        ({"action": "stop", "name": "rc_lost"}, set()),
        ({"action": "clear"}, set()),
        ({"action": "list"}, set()),
    ],
)
def test_requests(simulation, fields, running):
    result = apply_fault_request(simulation, FaultRequest.model_validate(fields), STAMP)
    assert set(result.reply["active"]) == running == set(simulation.world.faults.active)
    assert SimFaults.model_validate(result.reply)
    assert result.reply_type == "SimFaults.v1"


def test_truth_is_the_worlds(simulation):
    truth = truth_of(simulation, STAMP)
    assert truth.position_enu == tuple(simulation.world.truth.position_enu)
    assert truth.airborne is False


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
