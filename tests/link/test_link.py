"""The whole link, in virtual time, against the simulated boards; floods."""

from __future__ import annotations

import asyncio

import pytest

from lab.rigs.boardport import LineFault
from lab.rigs.linkrig import Log, flight_ctrl, navi_ctrl, on_line, rig, virtually
from lab.rigs.sticks import build_sticks
from lab.rigs.waiting import running
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.errors import CommandRejectedError, LinkLostError, RequestTimeoutError
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.link.session.dialogue import Dialogue
from mkdaemon.link.session.exchange import TURN_BYTES
from mkdaemon.link.session.traffic import Purpose, SetpointRefused
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.framing import encode_frame
from mkdaemon.protocol.messages import (
    AttitudeRequest,
    ControlStateRequest,
    DebugRequest,
    EchoRequest,
    ExternControlV2,
    LabelRequest,
    SelectSettings,
    SerialChannels,
    VersionRequest,
)
from mkdaemon.protocol.wire import Board
from mkdaemon.telemetry.control import Obstacle

EVERY_FC = ("early", "2.08", "2.12a", "2.14")


@pytest.mark.parametrize("word", EVERY_FC)
@virtually
async def test_the_first_bytes_are_a_release_and_then_one_in_the_right_layout(word):
    async with rig(flight_ctrl(word)) as r:
        await r.until_up()
        await asyncio.sleep(0.5)
        assert r.socket.wire[0][1].startswith(b"\r\r#bb=============")
        layout = r.link.dialect.extern_control
        assert layout is not None
        right = [s for s in r.log.tx if s.purpose is Purpose.RELEASE and type(s.message) is layout]
        assert len(right) >= 5
        assert all(int(s.message.config) == 0 for s in right)
        assert r.link.health().confirm.lost == 0
        assert r.link.boards == {Board.FC}


@pytest.mark.parametrize("rate", [15, 100])
@pytest.mark.parametrize("make", [flight_ctrl(), navi_ctrl("2.14", "2.14")], ids=["fc", "nc"])
@virtually
async def test_no_control_frame_is_lost_at_any_rate(make, rate):
    async with rig(make, rates={"attitude": 50, "debug": 200, "osd": 200}) as r:
        await r.until(lambda: r.link.dialect.extern_control is not None, 3)
        await asyncio.sleep(1)
        layout = r.link.dialect.extern_control
        loop = asyncio.get_running_loop()
        began = loop.time()
        for step in range(4 * rate):
            await asyncio.sleep(max(0.0, began + step / rate - loop.time()))
            setpoint = build_sticks(layout, pitch=step % 20)
            r.link.send_setpoint(setpoint, deadline=loop.time() + 0.1)
        await asyncio.sleep(0.4)
        health = r.link.health()
        assert health.confirm.lost == health.confirm.replaced
        assert health.echo.lost == 0
        sent = [s.at for s in r.log.tx if s.purpose is Purpose.SETPOINT]
        requests = sum(sent[0] <= s.at <= sent[-1] and s.purpose is not Purpose.SETPOINT for s in r.log.tx)
        wanted = 4 * min(rate, 44) - (requests if r.link.boards == {Board.FC} else 0)  # each in the place of a frame
        assert wanted - 6 <= len(sent) <= 4 * 46
        assert health.stick_frames.sent >= len(sent)


@virtually
async def test_requests_fail_in_the_words_of_the_tree():
    async with rig(navi_ctrl()) as r:
        with pytest.raises(LinkLostError):
            await r.link.request(VersionRequest())
        await r.until_up()
        await asyncio.sleep(0.5)
        with pytest.raises(CommandRejectedError) as caught:
            await r.link.request(ControlStateRequest())
        assert caught.value.token == "board_unreachable"
        r.socket.port.inject(LineFault.ONE_WAY)
        with pytest.raises(RequestTimeoutError, match="asked 3 times"):
            await r.link.request(LabelRequest(index=1), timeout=0.05, retries=2)
        asking = asyncio.create_task(r.link.request(LabelRequest(index=1)))
        await asyncio.sleep(0.01)
        r.socket.unplug()
        with pytest.raises(LinkLostError):
            await asking
    async with rig(flight_ctrl()) as r:
        await r.until_up()
        with pytest.raises(CommandRejectedError) as caught:
            await r.link.request(EchoRequest(pattern=1))
        assert caught.value.token == "board_unreachable"


@on_line(flight_ctrl())
async def test_a_cancelled_question_leaves_nothing_behind(r):
    r.socket.port.inject(LineFault.SILENCE)
    asking = asyncio.create_task(r.link.request(LabelRequest(index=3)))
    await asyncio.sleep(0.02)
    asking.cancel()
    await asyncio.gather(asking, return_exceptions=True)
    r.socket.port.inject(LineFault.NONE)
    await r.until_up(6)
    sent = sum(s.message == LabelRequest(index=3) for s in r.log.tx)
    assert sent == 1
    assert (await r.link.request(LabelRequest(index=4))).index == 4


@on_line(flight_ctrl())
async def test_what_has_no_answer_is_sent_not_asked(r):
    silent = SerialChannels(channels=(0,) * 12)
    assert await r.link.send(silent) is None
    assert r.log.tx[-1].message == silent
    with pytest.raises(CommandRejectedError) as caught:
        await r.link.request(silent)
    assert caught.value.token == "no_reply"


@on_line(navi_ctrl(), rates={"osd": 200})
async def test_rates_change_at_run_time_and_only_within_the_line(r):
    await asyncio.sleep(3)
    r.link.set_rate("osd", 0.05)
    r.link.set_rate("attitude", 0.05)
    await asyncio.sleep(12)
    rates = {kind.key: kind.rate for kind in r.link.health().kinds}
    assert rates["osd"] == pytest.approx(20, rel=0.05)
    assert rates["attitude"] == pytest.approx(20, rel=0.05)
    with pytest.raises(CommandRejectedError, match=r"need .* % of the line"):
        r.link.set_rate("debug", 0.02)
    with pytest.raises(CommandRejectedError) as caught:
        r.link.set_rate("weather", 0.1)
    assert caught.value.token == "no_such_stream"
    r.link.set_rate("osd", 0)
    r.link.set_rate("osd", 0)
    began = len(r.log.rx)
    await asyncio.sleep(1)
    assert all(f.frame.id != "O" for f in r.log.rx[began + 3 :])
    assert r.link.rates() == {"attitude": pytest.approx(0.05)}


@on_line(navi_ctrl(), rates={"osd": 100})
async def test_streams_live_longer_than_the_boards_timer_and_rates_survive_a_replug(r):
    await asyncio.sleep(0.5)
    r.link.set_rate("osd", 0.2)
    await asyncio.sleep(10)
    renewals = [s for s in r.log.tx if s.purpose is Purpose.SUBSCRIPTION]
    assert all(s.message.interval == 0 for s in renewals[4:])
    r.socket.unplug()
    await asyncio.sleep(1)
    r.socket.is_present = True
    await r.until_up(3)
    await asyncio.sleep(11)
    rates = {kind.key: kind.rate for kind in r.link.health().kinds}
    assert rates["osd"] == pytest.approx(5, rel=0.1)


@on_line(navi_ctrl(), rates="off", probe_flightctrl=False)
async def test_streams_can_be_off_and_echo_alone_keeps_the_truth(r):
    await asyncio.sleep(2)
    assert not r.log.kinds(since=1.0).keys() & set("OCD")
    r.socket.port.inject(LineFault.SILENCE)
    assert await r.until(lambda: r.condition == "mute", 0.5) <= 0.5


@on_line(flight_ctrl(), echo_hz="auto", rates={"attitude": 50})
async def test_auto_echo_yields_to_confirmations_but_not_to_silence(r):
    loop = asyncio.get_running_loop()
    await asyncio.sleep(0.5)
    began = loop.time()
    for _ in range(100):
        r.link.send_setpoint(build_sticks(ExternControlV2), deadline=loop.time() + 0.1)
        await asyncio.sleep(0.02)
    echoes = [s for s in r.log.tx if s.purpose is Purpose.ECHO and s.at > began + 0.1]
    assert echoes == []
    await asyncio.sleep(2)
    echoes = [s for s in r.log.tx if s.purpose is Purpose.ECHO and s.at > began + 2.1]
    assert len(echoes) >= 8


@on_line(navi_ctrl(), rates={"osd": 100, "attitude": 100}, probe_flightctrl=False)
async def test_a_stream_that_a_clients_own_request_starts_is_in_the_budget_and_ends(r):
    with pytest.raises(CommandRejectedError) as caught:
        await r.link.request(DebugRequest(interval=1))
    assert caught.value.token == "line_budget"
    assert "%" in caught.value.reason
    began = asyncio.get_running_loop().time()
    await r.link.request(DebugRequest(interval=10))
    assert r.link.rates() == {"osd": 0.1, "attitude": 0.1, "debug": 0.1}
    await asyncio.sleep(3)
    assert r.log.kinds(began)["D"] > 20
    await r.link.request(AttitudeRequest(interval=5))
    assert r.link.rates()["attitude"] == 0.05
    await asyncio.sleep(6)
    assert r.link.rates() == {"osd": 0.1, "attitude": 0.1}
    late = asyncio.get_running_loop().time()
    await asyncio.sleep(5)
    kinds = r.log.kinds(late)
    assert kinds["D"] == 0, "no renewal of another stream keeps it alive"
    assert 40 <= kinds["C"] <= 60
    await r.link.request(DebugRequest(interval=10))
    await r.link.request(DebugRequest(interval=0))
    assert "debug" not in r.link.rates()


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


FRAMES = 2_000
SHORTEST = 6


class FloodedPort:
    """A port on which thousands of valid frames arrive at once."""

    name, backlog, descriptor, is_recording = "flood", 0, None, False

    def __init__(self, frames):
        self._chunks = [encode_frame(2, "Q") * frames]

    async def read(self):
        if self._chunks:
            return self._chunks.pop()
        await asyncio.Event().wait()
        return b""

    def write(self, data):
        pass

    def discard(self):
        pass

    async def drain(self):
        pass

    async def close(self):
        pass


@virtually
async def test_a_flood_of_valid_frames_leaves_every_turn_of_the_loop_to_others():
    log, most, turns = Log(), 0, 0

    async def open_flooded(url, *, baud):
        return FloodedPort(FRAMES)

    clock = Clock(monotonic=asyncio.get_running_loop().time)
    link = Link(LinkConfig(port="/dev/flood"), log, opener=open_flooded, clock=clock, motors_running=lambda now: None)
    async with running(link.run(discover)):
        while len(log.rx) < FRAMES:
            before = len(log.rx)
            await asyncio.sleep(0)
            most, turns = max(most, len(log.rx) - before), turns + 1
    assert most <= TURN_BYTES // SHORTEST + 1
    assert turns >= FRAMES * SHORTEST / TURN_BYTES
