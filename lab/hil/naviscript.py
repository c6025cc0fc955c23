"""The bytes that a genuine and a simulated NaviCtrl get, and what each makes of them.

One script, the same characters at the same times to both; behind both flies the simulator's FlightCtrl, in the same
world. What they say is compared item by item: which replies, how many, how soon, and every field.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mkdaemon.protocol.flags import PositionStatus
from mkdaemon.protocol.framing import Frame, FrameDecoder, encode_frame
from mkdaemon.protocol.messages import WriteWaypoint024
from mksim.physics.pilot import GPS_SWITCH, GPS_SWITCH_VALUES
from mksim.programs.rehearsal import FlyingAircraft

STEP: Final = 1e-3
"""[s]."""
FC, NC, ANY = 1, 2, 0
ESCAPE: Final = b"\x1b\x1b\x55\xaa\x00"
PLACE: Final = (89_000_000, 489_000_000)


class Item(NamedTuple):
    """Something the host does, and how long it listens.

    Attributes:
        name: of it.
        sent: bytes, each with the time from the beginning [s].
        lasts: how long it listens [s].
        switch: what the pilot turns the GPS switch to first; None leaves it.
    """

    name: str
    sent: tuple[tuple[float, bytes], ...]
    lasts: float = 0.5
    switch: str | None = None


@dataclass(slots=True)
class Answers:
    """What a board answered.

    Attributes:
        frames: with the times their last characters arrived, from the beginning of the item [s].
        text: outside frames.
        held: external control as the FlightCtrl behind holds it at the end.
    """

    frames: list[tuple[float, Frame]] = field(default_factory=list)
    text: bytes = b""
    held: str = ""

    @property
    def kinds(self) -> dict[str, list[Frame]]:
        """The frames of each kind: of which board, and its letter."""
        found: defaultdict[str, list[Frame]] = defaultdict(list)
        for _, frame in self.frames:
            found[f"{'.fnm'[frame.address]}{frame.id}"].append(frame)
        return found


def frame(letter: str, payload: Sequence[int] | bytes = b"", board: int = NC) -> bytes:
    """A frame with its payload."""
    return encode_frame(board, letter, bytes(payload))


def _one(name: str, letter: str, payload: Sequence[int] = (), lasts: float = 0.5, board: int = NC) -> Item:
    return Item(name, ((0.0, frame(letter, payload, board)),), lasts)


def point(index: int, *, kind: int = 0, status: int = 1, north: int = 0) -> bytes:
    """A waypoint's payload, `north` metres north of home."""
    longitude, latitude = PLACE
    made = WriteWaypoint024.decode(bytes(30)).model_copy(
        update={
            "longitude": longitude,
            "latitude": latitude + north * 90,
            "status": PositionStatus(status),
            "index": index,
            "type": kind,
            "tolerance_radius": 5,
            "hold_time": 2,
        }
    )
    return made.encode()


def _once(name: str, letter: str, switch: str | None = None) -> Item:
    """One frame of a stream, half a second after the pilot turned the GPS switch."""
    return Item(name, ((0.5, frame(letter, (100,))), (0.7, frame(letter, (0,)))), 1.0, switch)


def _passed(name: str, to: int, *asked: tuple[float, bytes], lasts: float = 1.0) -> Item:
    """The line is passed through to another board, something is asked there, and back."""
    return Item(name, ((0.0, frame("u", (to,))), *asked, (0.6, ESCAPE)), lasts)


def _write(name: str, *points: bytes, lasts: float = 0.5) -> Item:
    return Item(name, tuple((0.1 * k, frame("w", raw)) for k, raw in enumerate(points)), 0.1 * len(points) + lasts)


def _control(number: int) -> bytes:
    return frame("b", (10, 0xF6, 5, 0x9C, number, 1, 0), board=FC)


GROUND: Final = (
    _one("version", "v"),
    _one("version, any board", "v", board=ANY),
    _one("version of the FlightCtrl", "v", board=FC),
    _one("error text", "e"),
    _one("label 0", "a", (0,)),
    _one("label 31", "a", (31,)),
    _one("label 40", "a", (40,)),
    _one("OSD data every 100 ms, to the time-out", "o", (10,), 5.0),
    _one("debug data every 100 ms, to the time-out", "d", (10,), 5.0),
    _one("3D data every 50 ms, to the time-out", "c", (5,), 5.0),
    _one("OSD data, interval 0", "o", (0,)),
    Item(
        "three streams, begun and ended",
        tuple((at, frame(x, (n,))) for at, n in ((0.0, 10), (1.9, 0)) for x in "odc"),
        2.3,
    ),
    Item("version on a saturated line", ((0.0, frame("o", (1,))), (0.05, frame("v"))), 5.0),
    _one("display, page 0", "h", (0xFF, 0)),
    _one("display, next page", "h", (0xFD, 0)),
    _one("display, page before", "h", (0xFE, 0)),
    _one("display every 200 ms", "h", (0xFF, 20), 1.0),
    _one("display in the obsolete format", "h", (0x7F, 0)),
    _one("menu page 3", "l", (3,)),
    _one("menu page 99", "l", (99,)),
    Item("echo, 20 times", tuple((0.05 * k, frame("z", (k, 7))) for k in range(20)), 1.2),
    Item("two echoes at once", ((0.0, frame("z", (1, 2)) + frame("z", (3, 4))),)),
    _one("parameter 4, ask", "j", (0, 4, 0, 0)),
    _one("parameter 4, set", "j", (1, 4, 200, 1)),
    _one("parameter 4, ask again", "j", (0, 4, 0, 0)),
    _one("point 1, empty list", "x", (1,)),
    _write("clear", point(0, status=0)),
    _write("three points", point(1, north=10), point(2, north=20), point(3, north=30)),
    _one("point 2", "x", (2,)),
    _one("point 4 of 3", "x", (4,)),
    _one("point 0", "x", (0,)),
    _write("a point of interest", point(4, kind=1, north=5)),
    _once("OSD data with points", "o"),
    _write("a point out of the list", point(32)),
    _write("point 2 withdrawn", point(2, kind=255)),
    _one("point 2, withdrawn", "x", (2,)),
    _one("point 3, behind it", "x", (3,)),
    _one("target on the ground", "s", point(1, north=15)),
    _write("clear again", point(0, status=0)),
    Item("an unknown letter", ((0.0, frame("?")), (0.1, frame("v"))), 0.4),
    Item("a wrong sum", ((0.0, b"#cv==?\r"), (0.1, frame("v"))), 0.4),
    Item("a frame cut short", ((0.0, b"#co"), (0.1, frame("v"))), 0.4),
    Item("a frame too long", ((0.0, b"#c" + b"=" * 200 + b"\r"), (0.3, frame("v"))), 0.6),
    Item("external control, 20 Hz", tuple((0.05 * k, _control(k + 1)) for k in range(40)), 2.1),
    Item("external control, 100 Hz", tuple((0.01 * k, _control(k + 1)) for k in range(100)), 1.1),
    Item("serial channels", ((0.0, frame("y", range(12), board=FC)),)),
    _passed("passed to the FlightCtrl and back", 0, (0.3, frame("v", board=FC))),
    _passed("passed to the compass and back", 1, (0.3, frame("v", board=ANY))),
    _passed("passed to the GPS and back", 2),
    Item(
        "passed on while a stream runs",
        ((0.0, frame("o", (10,))), (0.52, frame("u", (0,))), (0.8, ESCAPE), (1.0, frame("o", (0,)))),
        1.5,
    ),
    _passed("three escapes, and the sequence", 0, (0.3, b"\x1b" + ESCAPE)),
    _one("version after it", "v"),
    Item("only echoes for 9 s", tuple((0.5 * k, frame("z", (k, 1))) for k in range(18)), 9.2),
    Item("flags after it", ((0.0, frame("o", (100,))), (0.2, frame("o", (0,)))), 1.3),
    _once("flags a second later", "o"),
)
"""With the motors at rest."""
FLIGHT: Final = (
    _once("OSD data in flight", "o"),
    _once("debug data in flight", "d"),
    _once("3D data in flight", "c"),
    _one("passed to the compass in flight", "u", (1,)),
    _write("a point in flight", point(1, north=10)),
    _once("OSD data with it", "o"),
    _once("switch to coming home", "o", "home"),
    _once("switch to hold", "o", "hold"),
    _write("clear in flight", point(0, status=0)),
    _once("switch to coming home, no list", "o", "home"),
    _once("switch to free", "o", "free"),
    _one("target in flight", "s", point(1, north=10)),
    _once("OSD data with a target", "o"),
)
"""Hovering by hand."""
LAST: Final = (Item("boot loader", ((0.0, frame("R")), (0.5, frame("v"))), 1.0),)


def listen(boards: FlyingAircraft, item: Item, held: Callable[[], str]) -> Answers:
    """Let the host do something, and return what the board answers."""
    if item.switch is not None:
        boards.world.pilot.switches[GPS_SWITCH] = GPS_SWITCH_VALUES[item.switch]
    began, found, decoder = boards.now, Answers(), FrameDecoder()
    left = list(item.sent)
    while boards.now < began + item.lasts:
        while left and left[0][0] <= boards.now - began + 1e-9:
            boards.write(left.pop(0)[1], boards.now)
        for at, data in boards.advance(boards.now + STEP):
            for one in decoder.feed(data):
                if isinstance(one, Frame):
                    found.frames.append((at - began, one))
                else:
                    found.text += one.raw
    found.held = held()
    return found
