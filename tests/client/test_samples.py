"""Typed values from maps."""

from __future__ import annotations

import pytest

from mkdaemon.bus.codec import encoding_of
from mkdaemon.client import Sample
from mkdaemon.client.samples import message_from, read_payload
from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.messages import Settings
from mkdaemon.telemetry.state import Attitude


def test_a_message_is_made_again_from_its_fields_or_an_error_names_the_field_that_does_not_fit():
    with pytest.raises(ProtocolError, match=r"this is no Attitude\.v1 as known here: stamp: field required"):
        _ = Sample("state/attitude", {"yaw": 1.0}, encoding_of(Attitude)).value
    message = Settings(index=3, parameters=bytes(range(100)))
    assert message_from("Settings.v1", dict(message)) == message
    with pytest.raises(ProtocolError, match="unknown here"):
        message_from("Settings.v1", {"index": 3})
    with pytest.raises(ProtocolError, match=r"Later\.v1 \(empty\)"):
        message_from("Later.v1", {})


@pytest.mark.parametrize(
    ("encoding", "raw", "fields"),
    [
        ("application/msgpack;mk.X.v1", b"\x81\xa1a\x01", {"a": 1}),
        ("application/msgpack", b"\x93\x01\x02\x03", {"value": [1, 2, 3]}),
        ("application/schema+json", b'{"a": 1}', {"a": 1}),
        ("text/plain", b"hello", {"raw": b"hello"}),
        ("application/msgpack;mk.X.v1", b"\x81\x01\x02", {"raw": b"\x81\x01\x02"}),
        ("application/msgpack", b"\x81\xa1a", {"raw": b"\x81\xa1a"}),
        ("application/msgpack", b"\x80\x80", {"raw": b"\x80\x80"}),
        ("application/msgpack", b"\x91" * 3000, {"raw": b"\x91" * 3000}),
        ("application/json", b"{", {"raw": b"{"}),
        ("application/json", b"[" * 100_000, {"raw": b"[" * 100_000}),
    ],
)
def test_payloads_are_read_by_their_encoding(encoding, raw, fields):
    assert read_payload(encoding, raw) == fields
