"""Adding a message is one class: everything else reads its declaration."""

from __future__ import annotations

import json
from typing import Annotated

import pytest

from mkdaemon.bus.codec import schema_name
from mkdaemon.cli.mkctl.send import request_forms
from mkdaemon.cli.mkdaemon.schema import describe_message
from mkdaemon.control.admission.beginnings import BoardRequest
from mkdaemon.control.admission.rows import refusal
from mkdaemon.link.session.questions import answers
from mkdaemon.link.session.streamkinds import find_streams
from mkdaemon.protocol import MESSAGES, Board, FrameDecoder, MessageDecoder
from mkdaemon.protocol.fields import U8, U16
from mkdaemon.protocol.matching import same
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy, StreamSpec
from mkdaemon.protocol.units import DECIVOLT, TEN_MS
from mkdaemon.protocol.wire import WireMessage, answer, request
from mkdaemon.telemetry.danger import Confirm, Danger
from mkdaemon.telemetry.refusals import Token
from tests.control.admission.situations import GOOD


@pytest.fixture
def lamp():
    """A request and its answer, declared for the length of a test."""
    before = dict(MESSAGES)

    @request(
        Board.NC,
        "q",
        reply="Q",
        firmware="NC 9.0",
        source=Source.INFERRED,
        policy=Policy(0.7, 1, deaf=0.1),
        matches=same("number"),
        stream=StreamSpec("lamp", renews=9),
        danger=Danger(effect="blinds the pilot", confirm=Confirm.ALWAYS),
    )
    class LampRequest(WireMessage):
        """Light a lamp."""

        number: Annotated[int, U8(mk="Nr", low=1, high=4)]
        interval: Annotated[int, U8(mk="Interval", unit=TEN_MS)] = 0

    @answer(Board.NC, "Q", firmware="NC 9.0", source=Source.INFERRED)
    class Lamp(WireMessage):
        """State of a lamp."""

        number: Annotated[int, U8(mk="Nr")]
        voltage: Annotated[int, U16(mk="U", unit=DECIVOLT)]

    yield LampRequest, Lamp
    MESSAGES.clear()
    MESSAGES.update(before)


def test_one_class_is_enough_everywhere(lamp):
    asked, answered = lamp
    (frame,) = FrameDecoder().feed(asked(number=2).to_frame())
    assert MessageDecoder().decode(frame) == asked(number=2), "the codec"
    assert (asked.spec.key, answered.spec.key) == ("lamp_request", "lamp"), "the keys"
    assert schema_name(asked) == "LampRequest.v1", "the schema"
    assert "x-firmware-word" in json.dumps(asked.model_json_schema())
    form = request_forms()["lamp_request"]
    assert [field.name for field in form.fields] == ["number", "interval"], "the command line"
    assert form.danger == "blinds the pilot"
    assert describe_message(Board.NC, asked)["danger"] == "blinds the pilot", "the table for machines"
    assert asked.spec.policy(Board.NC) == Policy(0.7, 1, deaf=0.1), "the policies"
    assert asked.spec.policy(Board.FC) == Policy()
    assert answers(asked(number=2), Board.NC, answered(number=2, voltage=1), Board.NC), "the matching"
    assert not answers(asked(number=2), Board.NC, answered(number=3, voltage=1), Board.NC)
    stream = find_streams()["lamp"]
    assert (stream.reply, stream.characters) == ("Q", 10), "the streams"
    error = refusal(BoardRequest(board="nc", name="lamp_request", danger=asked.spec.danger), GOOD)
    assert error is not None
    assert error.token == Token.NOT_CONFIRMED, "admission"
