"""What passes inside the daemon becomes entries: numbered, timed, and without the secret of a lease."""

from __future__ import annotations

import msgpack

from mkdaemon.clock import Clock
from mkdaemon.protocol.boards import Board
from mkdaemon.record.entry import EntryKind, Notice, TimeBase
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.tap import Tap, hide_secrets
from mkdaemon.stamp import Stamp

STAMP = Stamp(monotonic=41.5, wall=1_760_000_041.25, boot="0123abcd")


def tapped(capacity=10**6):
    clock = Clock(monotonic=lambda: 42.0, wall=lambda: 1_760_000_042.0, synchronised=lambda: True)
    queue = EntryQueue(capacity)
    return Tap(queue, clock, "mk1", TimeBase.of(clock.stamp())), queue


def test_setpoints_and_bytes_have_the_time_they_were_taken_elsewhere():
    tap, queue = tapped()
    encoding = "application/msgpack;mk.StickSetpoint.v1"
    tap.setpoint("setpoint/stick", b"x", encoding, b"s" * 32, at=41.9, source="0a1b", is_holder=True)
    tap.port_read(b"#a", 41.8)
    tap.port_written(b"#b", 41.7, "release")
    tap.port_opened("/dev/ttyUSB0", 57600, 41.7)
    tap.port_lost("gone", 41.7)
    tap.layouts_changed({(Board.FC, "b"): "v2"}, 41.65)
    tap.notice(Notice.STOP, 41.6)
    setpoint, read, written, opened, lost, layouts, stop = queue.take(10)

    assert (setpoint.received, setpoint.attachment) == (41.9, b"s" * 32)
    assert (setpoint.issuer, setpoint.source) == ("holder", "0a1b")
    assert (read.received, read.payload, read.encoding) == (41.8, b"#a", "")
    assert (written.received, written.issuer) == (41.7, "release")
    assert msgpack.unpackb(opened.payload) == {"port": "/dev/ttyUSB0", "baud": 57600}
    assert msgpack.unpackb(lost.payload) == {"reason": "gone"}
    assert Notice.of(layouts) is Notice.LAYOUTS
    assert msgpack.unpackb(layouts.payload) == {"layouts": [["fc", "b", "v2"]]}
    assert (Notice.of(stop), stop.received, stop.payload) == (Notice.STOP, 41.6, b"")
    assert Notice.of(read) is None


def test_an_image_becomes_an_entry_on_the_writing_thread():
    tap, queue = tapped()
    for made in ((b"jpeg", "application/msgpack;mk.CameraFrame.v1"), None):
        tap.image("vision/front/image", lambda made=made: made, STAMP, "driver", at=41.75, size=100)
    first, second = (deferred() for deferred in queue.take(10))

    assert second is None
    assert (first.kind, first.key, first.payload) == (EntryKind.IMAGE, "mk/mk1/vision/front/image", b"jpeg")
    assert (first.received, first.published, first.issuer) == (41.75, STAMP.wall, "driver")


def test_the_secret_of_a_lease_is_never_recorded():
    asked = {"action": "renew", "epoch": 3, "secret": "ab12"}
    granted = {"status": "accepted", "reply": {"epoch": 3, "secret": "ab12", "list": [{"secret": "ab12"}]}}
    for value in (asked, granted):
        hidden = hide_secrets(msgpack.packb(value))
        assert b"ab12" not in hidden
        assert msgpack.unpackb(hidden).keys() == value.keys()
    assert msgpack.unpackb(hide_secrets(msgpack.packb({"secret": ""}))) == {"secret": ""}
    assert hide_secrets(b"\xc1secret") == b""
    plain = msgpack.packb({"reason": "whatever"})
    assert hide_secrets(plain) is plain
