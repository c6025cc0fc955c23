"""The log protocol against a folder of recordings, asked as QGroundControl and MAVSDK ask."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.modes import Numbering
from mkdaemon.telemetry.record import RecordStatus
from tests.gateways.mavlink import rig
from tests.gateways.mavlink.rig import Ears, beat, serving, virtually

NAMES = ("mk1-20260101T000000Z-000.mcap", "mk1-20260101T000000Z-001.mcap", "mk1-20260102T000000Z-000.mcap")
STARTS = (1_767_225_600, 1_767_225_600, 1_767_312_000)
STANDING = rig.flight(is_flying=False, motors_running=False)


@pytest.fixture
def folder(tmp_path):
    for index, name in enumerate(NAMES):
        (tmp_path / name).write_bytes(bytes((index + at) % 256 for at in range((0, 180, 5000)[index])))
    (tmp_path / "other-20260101T000000Z-000.mcap").write_bytes(b"xx")
    (tmp_path / "mk1-99999999T999999Z-000.mcap").write_bytes(b"x")
    return tmp_path


def status(file):
    return rig.made(RecordStatus, state="recording", file=str(file))


def knows(folder):
    return (*rig.EVERYTHING, STANDING, status(folder / NAMES[-1]))


async def ask_list(ears, start=0, end=0xFFFF):
    await ears.ask(mavlink.MAVLink_log_request_list_message(1, 1, start, end), seconds=0.3)


async def download(ears, number, at=0, count=0xFFFF_FFFF):
    ears.heard.clear()
    await ears.ask(mavlink.MAVLink_log_request_data_message(1, 1, number, at, count))
    found = ears.named("LOG_DATA")
    assert {message.id for message in found} == {number}
    for message in found:
        assert message.ofs == at
        at += message.count
    return b"".join(bytes(message.data[: message.count]) for message in found), [message.count for message in found]


@pytest.mark.parametrize(("numbering", "first"), [(Numbering.PX4, 0), (Numbering.ARDUPILOT, 1)])
@virtually
async def test_recordings_are_listed_and_sent_whole_and_in_part(folder, numbering, first):
    async with serving(values=knows(folder)) as gateway:
        ears = Ears(gateway, numbering)
        await ask_list(ears)
        entries = ears.named("LOG_ENTRY")
        assert [entry.id for entry in entries] == [number + first for number in range(len(entries))]
        assert {(entry.num_logs, entry.last_log_num) for entry in entries} == {(len(entries), len(entries) - 1 + first)}
        assert [(entry.time_utc, entry.size) for entry in entries[:3]] == [*zip(STARTS, (0, 180, 5000), strict=True)]
        assert {entry.size for entry in entries[3:]} <= {1}, "no other vehicle's"
        content = (folder / NAMES[2]).read_bytes()
        data, counts = await download(ears, 2 + first)
        assert data == content and counts[-1] < 90
        assert (await download(ears, 2 + first, 90, 200))[0] == content[90:290]
        data, counts = await download(ears, 1 + first)
        assert data == (folder / NAMES[1]).read_bytes() and counts == [90, 90, 0]  # its end is said
        assert await download(ears, 0 + first) == (b"", [0])
        assert await download(ears, 99) == (b"", [0])


@virtually
async def test_one_of_a_range_and_none_in_flight_and_none_is_erased(folder):
    async with serving(values=knows(folder)) as gateway:
        ears = Ears(gateway)
        await ask_list(ears, 1, 1)
        assert [entry.id for entry in ears.named("LOG_ENTRY")] == [1]
        gateway.value_arrived(rig.flight())
        ears.say(mavlink.MAVLink_log_request_data_message(1, 1, 2, 0, 90))
        await ears.ask(mavlink.MAVLink_log_erase_message(1, 1), seconds=0.3)
        assert not ears.named("LOG_DATA") and "while the motors are off" in ears.words and "not erased" in ears.words
        assert all((folder / name).exists() for name in NAMES)


@virtually
async def test_a_download_ends_when_it_is_asked_to(folder):
    (folder / NAMES[2]).write_bytes(bytes(200_000))
    async with serving(values=knows(folder)) as gateway:
        ears = Ears(gateway)
        await ask_list(ears)
        await ears.ask(mavlink.MAVLink_log_request_data_message(1, 1, 2, 0, 0xFFFF_FFFF), seconds=0.05)
        await ears.ask(mavlink.MAVLink_log_request_end_message(1, 1), seconds=0.05)
        sent = len(ears.named("LOG_DATA"))
        await beat(ears, 0.5)
        assert 0 < sent == len(ears.named("LOG_DATA")) < 2000
