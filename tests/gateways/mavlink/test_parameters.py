"""The parameter protocol against a vehicle that is told what to answer."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.parameterids import ids_of, short, value_of
from mkdaemon.protocol.settings import ParameterSet, known_revisions
from tests.gateways.mavlink.rig import RAW, Ears, FakeVehicle, beat, flight, serving, virtually

IDS = ids_of(RAW[0])
DENIED, NOT_THERE, OUT_OF_RANGE, READ_ONLY = 3, 1, 2, 5


def ask_all(ears):
    ears.say(mavlink.MAVLink_param_request_list_message(1, 1))


def write(ears, name, value, kind=mavlink.MAV_PARAM_TYPE_REAL32):
    ears.say(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))


def test_ids_never_change():
    """Files of parameters of ground stations have these names: a new one is added, none of these is renamed."""
    known = {parameter.id for revision in known_revisions() for parameter in ids_of(revision)}
    assert {"GYRO_P", "EXTERNAL_CONTROL", "EMER_THR", "EMER_THR_TIME", "CHANNELS_12", "GPS_MIN_SATS"} <= known
    assert {"ALT_MIN_THR", "SRV_PIT_CTRL", "OUT_1_WARN_PAT", "GMBL_OUT_2_CH", "MOTOR_SAFETY_SW"} <= known
    assert short("servo_failsafe_positions", 4) == "SRV_FS_POS_5" and len(known) == 148
    assert ids_of(1) == ()


@virtually
async def test_all_are_read(ears):
    ask_all(ears)
    await beat(ears, 2.0)
    found = {message.param_id: message for message in ears.named("PARAM_VALUE")}
    assert len(found) == len(IDS) + 2 == found["GYRO_P"].param_count
    stored = ParameterSet(RAW)
    assert {row.id: found[row.id].param_value for row in IDS} == {row.id: value_of(stored, row) for row in IDS}
    assert [message.param_index for message in found.values()] == list(range(len(found)))
    assert found["MK_ACTIVE_SET"].param_value == 3
    assert {message.param_type for message in found.values()} == {mavlink.MAV_PARAM_TYPE_REAL32}


def bits(number):
    """A whole number as its bits in a float, as programs of PX4 send it."""
    return struct.unpack("<f", struct.pack("<i", number))[0]


@pytest.mark.parametrize(
    ("value", "kind"),
    [(81.0, mavlink.MAV_PARAM_TYPE_REAL32), (81.0, mavlink.MAV_PARAM_TYPE_UINT8),
     (bits(81), mavlink.MAV_PARAM_TYPE_INT32)],
)  # fmt: skip
@virtually
async def test_a_write_is_saved_before_and_read_back(vehicle, ears, tmp_path, value, kind):
    write(ears, "GYRO_P", value, kind)
    await beat(ears, 0.5)
    (saved,) = tmp_path.iterdir()
    assert f"gyro_p = {ParameterSet(RAW)['gyro_p']}" in saved.read_text()
    name, (values,), options = vehicle.calls[-1]
    assert (name, values, options) == ("write", {"gyro_p": 81}, {"confirm": True, "slot": 3})
    assert [m.param_value for m in ears.named("PARAM_VALUE")] == [81.0, 81.0]
    write(ears, "CHANNELS_2", 9.0)
    await beat(ears, 0.5)
    assert vehicle.calls[-1][1][0] == {"channels": [*RAW[1:2], 9, *RAW[3:13]]}
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [("GYRO_P", 256.0, OUT_OF_RANGE), ("GYRO_P", -1.0, OUT_OF_RANGE), ("GYRO_P", 1.5, OUT_OF_RANGE),
     ("GYRO_P", float("nan"), OUT_OF_RANGE), ("GYRO_P", float("inf"), OUT_OF_RANGE),
     ("MK_ACTIVE_SET", 1.0, READ_ONLY), ("NOBODY", 1.0, NOT_THERE)],
)  # fmt: skip
@virtually
async def test_a_wrong_write_is_refused_and_what_it_is_told(vehicle, ears, name, value, error):
    write(ears, name, value)
    await beat(ears, 0.3)
    assert [m.error for m in ears.named("PARAM_ERROR")] == [error]
    assert [m.param_id for m in ears.named("PARAM_VALUE")] == ([] if error == NOT_THERE else [name])
    assert "write" not in vehicle.done


@virtually
async def test_a_slow_write_answers_with_the_old_value_and_with_the_new_one_when_it_is_stored(vehicle, ears, tmp_path):
    """A NaviCtrl and the FlightCtrl behind it take 5 s; MAVSDK repeats its PARAM_SET for 3 s and then gives up."""
    ask_all(ears)
    await beat(ears, 1.0)
    vehicle.slow, seen = 5.1, len(ears.named("PARAM_VALUE"))
    write(ears, "GYRO_P", 81.0)
    values = []
    for _ in range(12):
        await beat(ears, 0.5)
        write(ears, "GYRO_P", 81.0) if len(values) < 6 else None
        values.append([m.param_value for m in ears.named("PARAM_VALUE")[seen:]])
    old = float(ParameterSet(RAW)["gyro_p"])
    assert values[1] == [old] and values[3] == [old, 81.0] and values[-1] == [old, 81.0, 81.0]
    assert vehicle.done.count("write") == 1


@virtually
async def test_without_a_backup_nothing_is_written(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    fake = FakeVehicle()
    async with serving(fake, folder=blocked / "backups") as gateway:
        ears = Ears(gateway)
        write(ears, "GYRO_P", 81.0)
        await beat(ears, 0.3)
        assert [call for call, *_ in fake.calls] == ["backup"] and "cannot be created" in ears.words


@virtually
async def test_the_height_of_a_take_off_is_a_parameter_of_the_gateway(vehicle, gateway, ears):
    for height in (3.5, -1.0, float("nan")):
        write(ears, "MIS_TAKEOFF_ALT", height)
    await beat(ears, 0.2)
    assert [m.param_value for m in ears.named("PARAM_VALUE")] == [3.5] * 3 and not vehicle.calls
    assert [m.error for m in ears.named("PARAM_ERROR")] == [OUT_OF_RANGE] * 2
    gateway.value_arrived(flight(is_flying=False))
    await ears.order(mavlink.MAV_CMD_NAV_TAKEOFF, seconds=1.0)
    assert {fields["height"] for _, kind, fields in vehicle.setpoints if kind == "takeoff"} == {3.5}
