"""What crosses a line: a flood leaves every turn of the loop to others, and whoever records is shown all in order."""

from __future__ import annotations

import asyncio

from lab.rigs.boardport import LineFault, Socket
from lab.rigs.linkrig import Log, flight_ctrl, virtually
from lab.rigs.waiting import running
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.link.session.exchange import TURN_BYTES
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame

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


class Tap:
    """Keeps everything."""

    def __init__(self):
        self.told = []

    def port_opened(self, port, baud, at):
        self.told.append(("opened", (port, baud), at))

    def port_read(self, data, at):
        self.told.append(("read", data, at))

    def port_written(self, data, at, issuer):
        self.told.append(("written", (data, issuer), at))

    def port_lost(self, reason, at):
        self.told.append(("lost", reason, at))

    def layouts_changed(self, layouts, at):
        self.told.append(("layouts", dict(layouts), at))

    def of(self, *words):
        return [(what, at) for word, what, at in self.told if word in words]


def decoded(told):
    """The frames and messages of what was told, with their times."""
    raw, messages, found = FrameDecoder(), MessageDecoder(), []
    for word, what, at in told:
        match word:
            case "opened":
                raw = FrameDecoder()
            case "layouts":
                messages = MessageDecoder(what)
            case "read":
                found += [(at, item, messages.decode(item)) for item in raw.feed(what) if isinstance(item, Frame)]
    return found


@virtually
async def test_what_the_tap_was_told_gives_the_same_frames_and_messages_again():
    log, tap, loop = Log(), Tap(), asyncio.get_running_loop()
    socket = Socket(flight_ctrl("2.12a"), seed=3)
    cfg = LinkConfig.model_validate({"port": "/dev/rig", "rates": {"attitude": 50}})
    link = Link(cfg, log, opener=socket.open, clock=Clock(monotonic=loop.time), tap=tap)
    async with running(link.run(discover)):
        await asyncio.sleep(2.0)
        socket.port.inject(LineFault.UNPLUGGED)
        await asyncio.sleep(0.2)
        socket.is_present = True
        await asyncio.sleep(3.0)
    assert [what for what, _ in tap.of("opened")] == [("/dev/rig", 57600)] * 2
    assert [bool(what) for what, _ in tap.of("lost")] == [True, False]
    assert "unplugged" in tap.of("lost")[0][0]
    assert len(tap.of("layouts")) > 0
    assert [(data, at) for (data, _), at in tap.of("written")] == [(sent.raw, sent.at) for sent in log.tx]
    assert {issuer for (_, issuer), _ in tap.of("written")} >= {"release", "request"}
    again = decoded(tap.told)
    assert len(again) > 50
    assert again == [(frame.at, frame.frame, frame.message) for frame in log.rx]
