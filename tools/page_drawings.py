"""Pictures of how-to pages that are drawings: boxes with arrows, each declared here, and flights read from files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

from lab.places import CONFIGS
from mkdaemon.missions.format import read_mission
from mkdaemon.missions.script import GotoStep, LandStep, TakeOffStep, VelocityStep, WaitStep, read_script
from mkdaemon.telemetry.mission import MissionPoint, PointKind
from tools.screensvg import svg_of, svg_text

_WIDE, _HIGH, _GAP, _BETWEEN, _EDGE = 250, 80, 120, 50, 20
"""Size of a box, space between columns and between rows, and border [px]."""
_INK, _LINE, _PALE, _RED = "#222222", "#555555", "#f2f2f2", "#b00020"
_HEAD: Final = (
    '<defs><marker id="tip" markerWidth="10" markerHeight="8" refX="9" refY="4" orient="auto-start-reverse">'
    f'<path d="M 0 0 L 10 4 L 0 8 z" fill="{_LINE}"/></marker></defs>'
)
_DEGREE: Final = 111_195.0
"""A degree of latitude on a sphere of 6371 km [m]."""


class Box(NamedTuple):
    """One box: its place in the grid; its heading and up to two lines below."""

    column: int
    row: int
    lines: tuple[str, ...]


class Arrow(NamedTuple):
    """From one box to another; what goes there, and whether it goes both ways."""

    start: str
    end: str
    words: str = ""
    both: bool = False


class Drawing(NamedTuple):
    """Boxes by name, and the arrows between them."""

    boxes: dict[str, Box]
    arrows: tuple[Arrow, ...]


DRAWINGS: Final = {
    "quickstart": Drawing(
        {
            "sim": Box(0, 0, ("first terminal", "mkdaemon sim", "aircraft, pilot, radio")),
            "run": Box(1, 0, ("second terminal", "mkdaemon run", "the daemon")),
            "ctl": Box(2, 0, ("third terminal", "mkctl", "status and flight")),
            "real": Box(0, 1, ("a real aircraft", "instead of the simulator", "section 3")),
            "own": Box(2, 1, ("your own program", "any Zenoh client", "section 4")),
        },
        (
            Arrow("sim", "run", "/dev/pts/N", both=True),
            Arrow("run", "ctl", "Zenoh", both=True),
            Arrow("real", "run", "serial", both=True),
            Arrow("run", "own", "Zenoh", both=True),
        ),
    ),
    "hardware": Drawing(
        {
            "computer": Box(0, 0, ("computer", "mkdaemon run", "/dev/serial/by-id/...")),
            "adapter": Box(1, 0, ("USB serial adapter", "57600 baud, 8N1, TTL", "latency timer 1 ms")),
            "navi": Box(2, 0, ("NaviCtrl", "telemetry, link test,", "waypoints")),
            "camera": Box(0, 1, ("camera", "sees the target")),
            "radio": Box(1, 1, ("or a pair of XBee", "transparent, 57600 baud", "RO 0..3")),
            "flight": Box(2, 1, ("FlightCtrl", "settings, mixer, motor test,", "ExternalControl above 128")),
            "receiver": Box(2, 2, ("receiver", "the pilot's transmitter:", "a switch is the gate")),
        },
        (
            Arrow("computer", "adapter", "USB", both=True),
            Arrow("adapter", "navi", "RX, TX, GND", both=True),
            Arrow("computer", "radio", both=True),
            Arrow("radio", "navi", both=True),
            Arrow("navi", "flight", "in the aircraft", both=True),
            Arrow("camera", "computer", "images"),
            Arrow("receiver", "flight", "channels"),
        ),
    ),
    "replay": Drawing(
        {
            "bytes": Box(0, 0, ("recorded: bytes, layouts", "port_read, port_written")),
            "decoder": Box(1, 0, ("today's decoders", "FrameDecoder,", "MessageDecoder")),
            "states": Box(1, 1, ("today's translator", "StateTranslator")),
            "events": Box(0, 2, ("recorded: events, ticks", "core/*")),
            "core": Box(1, 2, ("today's FlightCore", "at the recorded times")),
            "images": Box(0, 3, ("recorded: images", "with their attitude")),
            "eyes": Box(1, 3, ("today's pipelines", "one for each camera")),
            "compare": Box(2, 1, ("compared", "with published values")),
            "answers": Box(2, 2, ("compared", "with published values", "and answers")),
        },
        (
            Arrow("bytes", "decoder"),
            Arrow("decoder", "states", "messages"),
            Arrow("decoder", "compare", "rx/*, tx/*"),
            Arrow("states", "compare", "state/*"),
            Arrow("states", "core", "states"),
            Arrow("events", "core"),
            Arrow("core", "answers", "control/*"),
            Arrow("images", "eyes"),
            Arrow("eyes", "answers", "vision/*, tf"),
        ),
    ),
    "security": Drawing(
        {
            "client": Box(0, 0, ("a program", "on this machine or in the", "network")),
            "known": Box(1, 0, ("certificate or password", "required where the", "network reaches the bus")),
            "access": Box(2, 0, ("access control", "if set up: drops what a", "role may not do")),
            "limits": Box(3, 0, ("lengths and rates", "too long: refused", "too often: `busy`")),
            "lease": Box(3, 1, ("the lease", "refuses a setpoint", "without its signature")),
            "core": Box(2, 1, ("flight core", "limits of every stick,", "release when silent")),
            "link": Box(1, 1, ("link", "one stick frame waits,", "none on a broken line")),
            "guard": Box(1, 2, ("guard", "separate process; releases", "if the daemon stops")),
            "board": Box(0, 1, ("FlightCtrl", "its own dead-man, and", "the pilot's gate")),
        },
        (
            Arrow("client", "known", "connects"),
            Arrow("known", "access", "identity"),
            Arrow("access", "limits", "messages"),
            Arrow("limits", "lease", "setpoints"),
            Arrow("lease", "core", "setpoints"),
            Arrow("core", "link", "sticks"),
            Arrow("link", "board", "sticks"),
            Arrow("guard", "board", "release"),
        ),
    ),
    "operations": Drawing(
        {
            "new": Box(0, 0, ("/opt/mkdaemon-NEW", "make install")),
            "old": Box(0, 1, ("/opt/mkdaemon-OLD", "kept for a roll-back")),
            "link": Box(1, 0, ("/opt/mkdaemon", "a link to one version")),
            "unit": Box(2, 0, ("mkdaemon.service", "dynamic user", "restarts on failure")),
            "config": Box(1, 1, ("/etc/mkdaemon/vehicle.toml", "port, vehicle, limits")),
            "state": Box(3, 0, ("/var/lib/mkdaemon", "recordings, notes for", "recovery")),
            "log": Box(3, 1, ("journal", "journalctl -u mkdaemon")),
            "ctl": Box(2, 1, ("mkctl", "the bus, or the Unix socket", "for `release`")),
        },
        (
            Arrow("link", "new", "ln -sfn"),
            Arrow("unit", "link", "starts"),
            Arrow("unit", "config", "reads"),
            Arrow("unit", "state", "writes"),
            Arrow("unit", "log", "writes"),
            Arrow("ctl", "unit", "asks"),
        ),
    ),
    "architecture": Drawing(
        {
            "guard": Box(1, 0, ("process: guard", "neutral, then release, if", "the daemon falls silent")),
            "core": Box(2, 0, ("FlightCore", "feed(event, now), tick(now)", "pure, no clock")),
            "recorder": Box(3, 0, ("thread recorder", "writes recordings")),
            "fc": Box(0, 1, ("FlightCtrl",)),
            "link": Box(1, 1, ("task link", "port, frames, requests,", "health")),
            "control": Box(2, 1, ("task control", "feeds and ticks the core,", "sends what it decides")),
            "zenoh": Box(3, 1, ("Zenoh's threads", "copy what arrives,", "verify its signature")),
            "clients": Box(4, 1, ("processes: clients", "mkctl, gateways,", "your program")),
            "nc": Box(0, 2, ("NaviCtrl",)),
            "sink": Box(1, 2, ("BusSink, translate", "frames to SI values,", "for the core and Zenoh")),
            "procedures": Box(2, 2, ("task procedures", "settings, waypoints")),
            "answers": Box(3, 2, ("threads bus.*", "answers to queries")),
            "camera": Box(0, 3, ("camera",)),
            "images": Box(1, 3, ("threads camera-NAME", "wait for images")),
            "vision": Box(2, 3, ("thread vision", "tags, pose; PoseSeen goes", "to the core")),
        },
        (
            Arrow("fc", "link", "bytes", both=True),
            Arrow("nc", "link", "bytes", both=True),
            Arrow("guard", "fc", "release"),
            Arrow("link", "guard", "stick frames"),
            Arrow("link", "sink", "Message"),
            Arrow("control", "link", "sticks"),
            Arrow("control", "core", "events, actions", both=True),
            Arrow("core", "recorder", "events"),
            Arrow("sink", "control", "StateValue"),
            Arrow("zenoh", "control", "setpoint"),
            Arrow("zenoh", "procedures", "query"),
            Arrow("procedures", "answers"),
            Arrow("answers", "zenoh"),
            Arrow("zenoh", "clients", "mk/NAME/...", both=True),
            Arrow("camera", "images", "images"),
            Arrow("images", "vision", "newest"),
        ),
    ),
}
"""By page."""


def arrow_head() -> str:
    """Return the definition of an arrow's head, `url(#tip)`."""
    return _HEAD


def architecture_picture(_root: Path) -> str:
    """Return processes, threads and tasks of the daemon, as SVG."""
    return _draw(DRAWINGS["architecture"])


def quickstart_picture(_root: Path) -> str:
    """Return the programs of the quick start and what joins them, as SVG."""
    return _draw(DRAWINGS["quickstart"])


def hardware_picture(_root: Path) -> str:
    """Return what is wired to what, as SVG."""
    return _draw(DRAWINGS["hardware"])


def replay_picture(_root: Path) -> str:
    """Return what a replay tells today's code and compares, as SVG."""
    return _draw(DRAWINGS["replay"])


def security_picture(_root: Path) -> str:
    """Return what a setpoint passes on its way to the aircraft, as SVG."""
    return _draw(DRAWINGS["security"])


def operations_picture(_root: Path) -> str:
    """Return what of an installation lies where, as SVG."""
    return _draw(DRAWINGS["operations"])


def _draw(drawing: Drawing) -> str:
    columns = 1 + max(box.column for box in drawing.boxes.values())
    rows = 1 + max(box.row for box in drawing.boxes.values())
    width = 2 * _EDGE + columns * _WIDE + (columns - 1) * _GAP
    height = 2 * _EDGE + rows * _HIGH + (rows - 1) * _BETWEEN
    parts = [_HEAD, f'<rect width="{width}" height="{height}" fill="#ffffff"/>']
    for box in drawing.boxes.values():
        x, y = _corner(box)
        place = f'x="{x}" y="{y}" width="{_WIDE}" height="{_HIGH}"'
        parts.append(f'<rect {place} rx="6" fill="{_PALE}" stroke="{_LINE}"/>')
        parts += [
            svg_text(x + 10, y + 24 + 20 * number, words, _INK, bold=not number)
            for number, words in enumerate(box.lines)
        ]
    for arrow in drawing.arrows:
        parts += _arrow(drawing.boxes[arrow.start], drawing.boxes[arrow.end], arrow)
    return svg_of(width, height, parts)


def _corner(box: Box) -> tuple[int, int]:
    return _EDGE + box.column * (_WIDE + _GAP), _EDGE + box.row * (_HIGH + _BETWEEN)


def _arrow(start: Box, end: Box, arrow: Arrow) -> list[str]:
    """From side to side; from above or below where both stand in one column."""
    (x, y), (to_x, to_y) = _corner(start), _corner(end)
    if start.column == end.column:
        is_down = to_y > y
        x, to_x = x + _WIDE // 2, to_x + _WIDE // 2
        y, to_y = (y + _HIGH, to_y) if is_down else (y, to_y + _HIGH)
        middle = x + 15 + 4.2 * len(arrow.words), (y + to_y) / 2
    else:
        is_right = to_x > x
        x, to_x = (x + _WIDE, to_x) if is_right else (x, to_x + _WIDE)
        y, to_y = y + _HIGH // 2, to_y + _HIGH // 2
        middle = (x + to_x) / 2, (y + to_y) / 2 - (14 if y == to_y else 0)
    both = ' marker-start="url(#tip)"' if arrow.both else ""
    line = f'<path d="M {x} {y} L {to_x} {to_y}" stroke="{_LINE}" stroke-width="2" marker-end="url(#tip)"{both}/>'
    if not arrow.words:
        return [line]
    half = 4.2 * len(arrow.words) + 2
    ground = f'x="{middle[0] - half:.1f}" y="{middle[1] - 8:.1f}" width="{2 * half:.1f}" height="18"'
    words = svg_text(middle[0], middle[1] + 5, arrow.words, _INK, anchor="middle")
    return [line, f'<rect {ground} fill="#ffffff"/>', words]


def flying_picture(_root: Path) -> str:
    """Return the steps of the sample flight by their heights, and the pilot's part, as SVG."""
    steps = [step for step in read_script(CONFIGS / "missions" / "hover.toml") if not isinstance(step, WaitStep)]
    wide, ground, metre = 190, 250, 110
    marks: list[tuple[float, str]] = [(0.0, "")]
    for step in steps:
        height: float = marks[-1][0]
        words: str = step.do
        match step:
            case TakeOffStep():
                height, words = step.height, f"take_off {step.height:g} m"
            case GotoStep():
                height, words = step.position[2], "goto " + " ".join(f"{part:g}" for part in step.position)
            case LandStep():
                height = 0.0
            case VelocityStep():
                height += step.velocity[2] * step.seconds
            case _:
                words = f"{step.do} {step.seconds:g} s"
        marks.append((height, words))
    width = 2 * _EDGE + (len(marks) - 1) * wide
    places = [(_EDGE + number * wide, ground - height * metre) for number, (height, _) in enumerate(marks)]
    path = " L ".join(f"{x} {y:.1f}" for x, y in places)
    parts = [
        f'<rect width="{width}" height="325" fill="#ffffff"/>',
        f'<path d="M {_EDGE} {ground} H {width - _EDGE}" stroke="{_LINE}"/>',
        f'<path d="M {path}" fill="none" stroke="{_INK}" stroke-width="3"/>',
        svg_text(_EDGE, 275, "pilot: motors on, throttle lowest, gate open", _RED),
        svg_text(
            _EDGE,
            300,
            "pilot, throughout: watches the aircraft; takes over by gate, sticks or GPS switch",
            _RED,
        ),
        svg_text(width - _EDGE, 275, "pilot: motors off", _RED, anchor="end"),
    ]
    for (left, first), (right, second), (_, words) in zip(places, places[1:], marks[1:], strict=False):
        parts.append(f'<circle cx="{right}" cy="{second:.1f}" r="5" fill="{_INK}"/>')
        parts.append(svg_text((left + right) / 2, min(first, second) - 12, words, _INK, bold=True, anchor="middle"))
    return svg_of(width, 325, parts)


def waypoints_picture(_root: Path) -> str:
    """Return the route of the sample mission from above, north up, as SVG."""
    points = read_mission(CONFIGS / "missions" / "field.gpx").points
    places = _metres(points)
    scale, left, top = 4.0, 90 - 4.0 * min(x for x, _ in places), 60 + 4.0 * max(y for _, y in places)
    at = [(left + scale * x, top - scale * y) for x, y in places]
    width, height = max(x for x, _ in at) + 260, max(y for _, y in at) + 60
    parts = [_HEAD, f'<rect width="{width:.0f}" height="{height:.0f}" fill="#ffffff"/>']
    flown = [place for place, point in zip(at, points, strict=True) if point.kind is not PointKind.POI]
    for (x, y), (to_x, to_y) in pairwise(flown):
        parts.append(f'<path d="M {x:.1f} {y:.1f} L {to_x:.1f} {to_y:.1f}" stroke="{_LINE}" stroke-width="2"/>')
    for number, ((x, y), point) in enumerate(zip(at, points, strict=True), start=1):
        is_poi = point.kind is PointKind.POI
        colour = _RED if is_poi else _INK
        if not is_poi:
            ring = f'cx="{x:.1f}" cy="{y:.1f}" r="{scale * point.radius:.1f}"'
            parts.append(f'<circle {ring} fill="none" stroke="{_LINE}" stroke-dasharray="4 4"/>')
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}"/>')
        hold = f", hold {point.hold} s" if point.hold else ""
        words = "looked at" if is_poi else f"{point.altitude:g} m{hold}"
        beside = x + 12 + scale * point.radius
        parts.append(svg_text(beside, y - 26, f"{number} {point.name}", colour, bold=True))
        parts.append(svg_text(beside, y - 8, words, colour))
    parts.append(svg_text(20, height - 15, "10 m", _INK))
    parts.append(f'<path d="M 65 {height - 20:.1f} h {10 * scale:g}" stroke="{_INK}" stroke-width="2"/>')
    parts.append(svg_text(30 + 10 * scale + 60, height - 15, "north is up", _INK))
    return svg_of(round(width), round(height), parts)


def _metres(points: Sequence[MissionPoint]) -> list[tuple[float, float]]:
    """East and north of the first point [m], as on a plane."""
    first = points[0]
    shrunk = math.cos(math.radians(first.latitude_deg))
    return [
        (
            (one.longitude_deg - first.longitude_deg) * _DEGREE * shrunk,
            (one.latitude_deg - first.latitude_deg) * _DEGREE,
        )
        for one in points
    ]
