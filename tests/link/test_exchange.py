"""An orderly exit: what goes on for ever is ended, and the last word is a release; streams of others are told."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.linkrig import flight_ctrl, navi_ctrl, on_line, rig, virtually
from mkdaemon.protocol.messages import DebugRequest
from mkdaemon.protocol.wire import Board


@pytest.mark.parametrize("word", ["2.12a", "2.08", "early"])
@virtually
async def test_the_debug_stream_of_a_flightctrl_ends_with_the_daemon(word):
    async with rig(flight_ctrl(word, **({"gas_law": "fork"} if word == "2.12a" else {}))) as r:
        await r.until_up()
        await r.until(lambda: "debug" in r.link.rates(), 2)
        await asyncio.sleep(1.0)
        r.task.cancel()
        await asyncio.gather(r.task, return_exceptions=True)
        sent = [frame.message for frame in r.log.tx if frame.message is not None]
        is_asked = sent[-2].spec.id == "d" and sent[-2].interval == 0
        assert is_asked is (word == "2.12a"), "a request would refresh the dead-man of the others"
        assert (sent[-1].spec.id, int(sent[-1].config)) == ("b", 0)
        boards = r.socket.aircraft
        boards.advance(r.socket.now() + (0.5 if is_asked else 5.0))
        after = b"".join(data for _, data in boards.advance(r.socket.now() + 12.0))
        assert b"#bD" not in after


@on_line(navi_ctrl(), rates={"osd": 500})
async def test_a_stream_that_another_program_left_behind_is_ended_and_told(r):
    await r.until(lambda: r.link.dialect.fc_release is not None, 3)
    await asyncio.sleep(1.0)
    r.socket.aircraft.write(DebugRequest(interval=20).to_frame(Board.NC), r.socket.now())
    await r.until(lambda: r.log.ended == ["debug"], 8)
    await asyncio.sleep(1.0)
    began = asyncio.get_running_loop().time()
    await asyncio.sleep(3.0)
    assert r.log.kinds(since=began)["D"] == 0
    assert r.log.kinds(since=began)["O"] > 0
    asked = [sent.message.interval for sent in r.log.tx if isinstance(sent.message, DebugRequest)]
    assert set(asked) == {0}, "it is ended, and never asked for"
