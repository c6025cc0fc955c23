"""What the link makes of frames nobody understands, of recordings, and of callers that do not wait any more."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.linkrig import flight_ctrl, on_line
from lab.rigs.sticks import build_sticks
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.link.session.traffic import SetpointRefused
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.framing import encode_frame
from mkdaemon.protocol.messages import SelectSettings, VersionRequest
from mkdaemon.protocol.messages.control import ExternControlV2
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.control import Obstacle


@on_line(flight_ctrl())
async def test_a_frame_that_no_message_fits_counts_as_a_frame_and_changes_nothing(r):
    before = r.link.dialect
    r.socket.port._deliver(encode_frame(1, "!", b"abc"))
    await r.until(lambda: isinstance(r.log.rx[-1].message, Unknown), 1.0)
    assert r.condition == "up"
    assert r.link.dialect == before
    assert r.link.direct_board is Board.FC


@on_line(flight_ctrl())
async def test_a_version_reply_of_a_length_nobody_knows_still_tells_who_is_there(r):
    r.socket.port._deliver(encode_frame(2, "V", bytes(3)))
    await r.until(lambda: Board.NC in r.link.boards, 1.0)
    assert r.link.direct_board is Board.NC


@on_line(flight_ctrl(), rates="off")
async def test_a_board_that_is_deaf_after_a_request_is_sent_nothing(r):
    await asyncio.sleep(2.0)
    await r.link.request(SelectSettings(index=3), board=Board.FC)
    asked = next(sent.at for sent in reversed(r.log.tx) if isinstance(sent.message, SelectSettings))
    await asyncio.sleep(2.0)
    after = [sent.at - asked for sent in r.log.tx if sent.at > asked]
    assert min(after) >= SelectSettings.spec.policy(Board.FC).deaf
    assert r.condition == "up"


def test_a_recording_is_asked_nothing_and_steered_nowhere():
    dialogue = Dialogue(LinkConfig(port="replay:x"), 0.0)
    dialogue.port_opened(0.0, baud=57600, is_recording=True)
    with pytest.raises(CommandRejectedError, match="recording"):
        dialogue.ask(VersionRequest(), Board.FC, 0.1)
    assert dialogue.control_line(0.1).obstacle is Obstacle.RECORDING
    fate = dialogue.steer(build_sticks(ExternControlV2), 0.3, 0.1)
    assert isinstance(fate, SetpointRefused)
    assert fate.refusal.token == "recording"


@on_line(flight_ctrl())
async def test_of_two_who_wait_for_a_release_one_may_give_up(r):
    impatient, patient = r.link.release("first"), r.link.release("second")
    impatient.cancel()
    assert (await patient).status == "confirmed"
