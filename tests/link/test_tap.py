"""Who records a line is told what crosses it, in order, so that it can be decoded again."""

from __future__ import annotations

import asyncio

from lab.rigs.boardport import LineFault, Socket
from lab.rigs.linkrig import Log, flight_ctrl, virtually
from lab.rigs.waiting import running
from mkdaemon.clock import Clock
from mkdaemon.config.link import LinkConfig
from mkdaemon.link.discovery import discover
from mkdaemon.link.link import Link
from mkdaemon.protocol.decoder import MessageDecoder
from mkdaemon.protocol.framing import Frame, FrameDecoder


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
