"""The file transfer protocol and the metadata that it carries, asked as MAVSDK and QGroundControl ask."""

from __future__ import annotations

import json
import struct

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mkdaemon.gateways.mavlink.metadata import COMPONENT_METADATA, Error, FileServer, Opcode, checksum, documents
from mkdaemon.gateways.mavlink.stations import By, Program
from tests.gateways.mavlink.rig import virtually

HEAD = struct.Struct("<HBBBBBxI")


def asked(opcode, data=b"", *, session=0, offset=0):
    head = HEAD.pack(9, session, opcode, len(data), 0, 0, offset)
    return mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list((head + data).ljust(251, b"\0")))


def answers(ears):
    """Opcode, session, burst is complete, offset and data of every answer."""
    found = []
    for message in ears.named("FILE_TRANSFER_PROTOCOL"):
        payload = bytes(message.payload)
        _, session, opcode, size, _, is_last, offset = HEAD.unpack_from(payload)
        found.append((opcode, session, is_last, offset, payload[HEAD.size :][:size]))
    ears.heard.clear()
    return found


def only(ears):
    (found,) = answers(ears)
    return found


@virtually
async def test_metadata_is_named_and_read_in_bursts(ears):
    ears.command(mavlink.MAV_CMD_REQUEST_MESSAGE, COMPONENT_METADATA)
    assert ears.acks == [(512, 0)]
    sent = ears.named(f"UNKNOWN_{COMPONENT_METADATA}")[0]  # no message of pymavlink 2.4.50
    found, uri = {}, "mftp://general.json"
    assert uri.encode() in sent.get_msgbuf()
    ears.heard.clear()
    while uri:
        name = uri.removeprefix("mftp://")
        ears.say(asked(Opcode.OPEN, name.encode()))
        _, session, _, _, size = only(ears)
        assert session == 0  # MAVSDK 4.1 asks for this one, whatever the answer said
        data, size = b"", int.from_bytes(size, "little")
        while len(data) < size:
            ears.say(asked(Opcode.BURST, session=session, offset=len(data)))
            parts = answers(ears)
            assert [is_last for _, _, is_last, *_ in parts] == [0] * (len(parts) - 1) + [1]
            for _, _, _, offset, part in parts:
                assert offset == len(data)
                data += part
        ears.say(asked(Opcode.BURST, session=session, offset=len(data)))
        assert only(ears)[0] == Opcode.NAK
        ears.say(asked(Opcode.TERMINATE, session=session))
        assert only(ears)[0] == Opcode.ACK
        found[name] = json.loads(data)
        uri = next((one["uri"] for one in found["general.json"]["metadataTypes"] if len(found) == 1), "")
        if uri:
            assert found["general.json"]["metadataTypes"][0]["fileCrc"] == checksum(documents(114)["parameter.json"])
    rows = {row["name"]: row for row in found["parameter.json"]["parameters"]}
    assert rows["GYRO_P"]["type"] == "Float" and rows["GYRO_P"]["max"] == 255
    assert rows["GYRO_P"]["longDesc"].startswith("Gyro_P in the firmware.")


@pytest.mark.parametrize(
    ("request_", "error"),
    [
        (asked(Opcode.OPEN, b"/etc/passwd"), Error.NOT_FOUND),
        (asked(Opcode.OPEN, b"\xff\0"), Error.NOT_FOUND),
        (asked(Opcode.READ, session=77), Error.INVALID_SESSION),
        (asked(Opcode.BURST, session=77, offset=1 << 31), Error.INVALID_SESSION),
        (asked(6, b"new"), Error.UNKNOWN_COMMAND),
        (asked(3, b"/"), Error.UNKNOWN_COMMAND),
    ],
)
@virtually
async def test_what_cannot_be_is_refused(ears, request_, error):
    ears.say(request_)
    opcode, _, _, _, data = only(ears)
    assert (opcode, data) == (Opcode.NAK, bytes([error]))


@virtually
async def test_few_files_stay_open(ears):
    server = FileServer()
    server.files = {"a": b"xyz" * 200}

    def ask(*what, system=255, **how):
        packed = asked(*what, **how).pack(mavlink.MAVLink(None, system, 190))
        by = By(ears.station, Program(system, 190))
        server.take(by, mavlink.MAVLink(None).decode(bytearray(packed)))

    for system in range(1, 41):
        ask(Opcode.OPEN, b"a", system=system)
    assert len(answers(ears)) == 40
    ask(Opcode.READ, system=1)
    assert only(ears)[4] == bytes([Error.INVALID_SESSION])
    ask(Opcode.READ, system=40, offset=478)
    assert only(ears)[4] == (b"xyz" * 200)[478:]
    ask(Opcode.RESET, system=40)
    ask(Opcode.READ, system=40)
    assert answers(ears)[1][4] == bytes([Error.INVALID_SESSION])
    ask(Opcode.ACK)
    assert not answers(ears)
