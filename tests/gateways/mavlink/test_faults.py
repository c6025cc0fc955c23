"""One station's message ends with its own fault; the gateway, the others and a flight go on."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways import boardset
from mkdaemon.gateways.mavlink import actions, missions
from mkdaemon.gateways.mavlink.modes import Mode
from mkdaemon.telemetry.control import Phase
from tests.gateways.mavlink.rig import EPOCH, POSITION, VELOCITY, Ears, beat, serving, status, virtually

HOLD, RTL, SET_MODE = 17, 20, 176
ACCEPTED, TEMPORARILY, FAILED = 0, 1, 4


class OddError(Exception):
    """Something that no code expects."""


def odd(*_, **__):
    raise OddError


async def odd_later(*_, **__):
    raise OddError


@pytest.mark.parametrize(
    ("owner", "name", "fails", "message"),
    [
        (boardset.GatewaySettings, "read", odd_later, mavlink.MAVLink_param_request_list_message(1, 1)),
        (missions.MissionServer, "tick", odd, None),
        (missions.MissionServer, "current", odd, None),
        (actions.Actions, "hold", odd_later, mavlink.MAVLink_command_long_message(1, 1, HOLD, 0, *[0] * 7)),
        (actions.Actions, "enter", odd_later, mavlink.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, 7, *[0] * 5)),
    ],
)
@virtually
async def test_a_fault_ends_its_message_only(monkeypatch, owner, name, fails, message):
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, fails)
        async with serving() as gateway:
            ears = Ears(gateway)
            if message is not None:
                ears.say(message)
            await beat(ears, 2.5)
            assert gateway.faults.count and len(ears.named("HEARTBEAT")) >= 2
            assert [result for _, result in ears.acks] == [FAILED] * len(ears.acks)


@virtually
async def test_an_empty_list_that_is_stored_slowly_is_asked_for_no_item(vehicle, gateway, ears):
    """`MISSION_COUNT 0` while the line is slow once asked for item -1, which no message holds."""
    vehicle.slow = 4.0
    await ears.ask(mavlink.MAVLink_mission_count_message(1, 1, 0, 0), seconds=5.0)
    assert ears.results == [mavlink.MAV_MISSION_ACCEPTED]
    assert gateway.faults.count == 0


@pytest.mark.parametrize(("command", "params"), [(RTL, ()), (SET_MODE, (1, 4, 5)), (SET_MODE, (1, 7))])
@virtually
async def test_a_second_ground_station_does_not_end_the_flight_of_the_first(vehicle, gateway, command, params):
    first, second = Ears(gateway), Ears(gateway, program=(254, 190))
    await first.order(HOLD)
    second.command(command, *params)
    await beat(first, 0.5)
    assert second.acks[-1] == (command, TEMPORARILY) and "may order hold or landing" in second.words
    assert vehicle.lease_now is not None
    await first.order(command, *params)
    assert first.acks[-1] == (command, ACCEPTED) and vehicle.lease_now is None


@virtually
async def test_250_system_ids_do_not_push_out_the_program_that_flies(vehicle, gateway, ears):
    await ears.order(HOLD)

    def crowd():
        gateway.value_arrived(status(Phase.FLYING, epoch=EPOCH, manoeuvre="hold"))
        for system in range(2, 250):
            ears.program = (system, 190)
            ears.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            ears.command(RTL)
            ears.command(SET_MODE, 1, 7)
        ears.program = (255, 190)

    await beat(ears, 2.5, crowd)
    assert vehicle.lease_now is not None and gateway.steering.order is not None
    assert ears.station.refused and gateway.faults.count == 0


@virtually
async def test_an_order_that_is_given_back_before_its_lease_begins_nothing(gateway, ears):
    ears.command(HOLD)
    await ears.order(RTL)
    assert gateway.faults.count == 0


@virtually
async def test_a_mode_is_accepted_or_refused_and_never_in_progress(vehicle, gateway, ears):
    """MAVSDK 4.1 crashes where the answer to DO_SET_MODE is IN_PROGRESS."""
    vehicle.engages = 10_000
    await ears.order(SET_MODE, 1, 4, 3, seconds=1.0)
    await ears.order(SET_MODE, 1, 4, 3, confirmation=1, seconds=13.0)
    assert ears.acks == [(SET_MODE, ACCEPTED)] * 2
    assert "did not engage" in ears.words and gateway.steering.shown_mode is not Mode.HOLD


@virtually
async def test_heights_have_one_reference_whatever_the_gps_drifts(gateway, ears):
    for drift in (-8.0, 0.0, 8.0):
        ears.heard.clear()
        here = POSITION.model_copy(update={"altitude": POSITION.altitude + drift})

        def arrive(here=here):
            gateway.value_arrived(VELOCITY)
            gateway.value_arrived(here)

        await beat(ears, 2.5, arrive)
        place, home = ears.named("GLOBAL_POSITION_INT")[-1], ears.named("HOME_POSITION")[-1]
        assert place.alt - home.altitude == place.relative_alt
