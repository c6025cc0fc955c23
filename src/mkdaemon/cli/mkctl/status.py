"""`mkctl status`: the aircraft, the link and who flies, on one screen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from rich.table import Table

from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.connection import HERE, Connection
from mkdaemon.cli.printing import age_of, json_line
from mkdaemon.cli.program import EXIT_FAILURE
from mkdaemon.client.summary import SEEN, WEAK_CELL
from mkdaemon.client.verdict import verdict_of_status
from mkdaemon.telemetry.link import fates_of

Fields = Mapping[str, Any]


async def status(*, connection: Connection = HERE) -> int:
    """Show the aircraft, the link and who flies.

    Exit code 0 while the vehicle is alive, 1 while it is not.

    Example: mkctl status --vehicle mk2
    """
    async with connection.open() as client:
        found = await client.status()
    known: dict[str, Fields] = {suffix: sample.fields for suffix, sample in found.samples.items()}
    if connection.json:
        print(json_line(known))
    else:
        Console().print(render(connection.vehicle, known, verdict_of_status(found)[0]))
    return 0 if found.is_alive else EXIT_FAILURE


def render(vehicle: str, known: Mapping[str, Fields], verdict: str = "") -> Table:
    """The screen.

    Args:
        vehicle: its name.
        known: fields of its last values, by key.
        verdict: the first line: the worst of them; empty for none.
    """
    table = Table(show_header=False, box=None, pad_edge=False, title=f"vehicle {vehicle}", title_justify="left")
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    table.add_column(style="dim", justify="right")
    if verdict:
        table.add_row("now", verdict, "")
    for name, key, line in _LINES:
        fields = known.get(key)
        text = line(fields) if fields else "unknown"
        if key == "state/battery" and fields:
            text += _cells(fields, known.get("health", {}))
        if not text:
            continue
        table.add_row(name, text, age_of(fields) if fields and key.startswith("state/") else "")
    for name, text in (*_losses(known), *_eyes(known)):
        table.add_row(name, text, "")
    return table


def _losses(known: Mapping[str, Fields]) -> Iterator[tuple[str, str]]:
    """A line for each kind of frame that wants an answer."""
    for title, fates in fates_of(known.get("link/health", {})).items():
        yield title, fates.words


def _eyes(known: Mapping[str, Fields]) -> Iterator[tuple[str, str]]:
    """A line for each camera, and one for the target that it saw last."""
    for key in sorted(known):
        root, _, kind = key.rpartition("/")
        if not root.startswith("vision/") or kind != "stats":
            continue
        stats = known[key]
        yield f"camera {stats['camera']}", _camera(stats)
        pose = known.get(f"{root}/pose")
        yield "target", "none seen yet" if pose is None else _target(pose)


def _camera(fields: Fields) -> str:
    if fields["state"] != "ok":
        return f"{fields['state']}: {fields['reason']}"
    words = [f"{fields['fps']:.0f} images a second, {100 * fields['posed']:.0f} % gave a pose"]
    return "; ".join([*words, *fields["alarms"].values()])


def _target(fields: Fields) -> str:
    x, y, z = fields["position_target"]
    place = f"{fields['target']} {math.hypot(x, y, z):.2f} m away, {z:+.2f} m above it"
    age = fields.get("age")
    if age is not None and age > SEEN:
        return f"NOT SEEN for {age:.0f} s; last {place}"
    return f"{place}, seen {age_of(fields)}"


def _cells(battery: Fields, health: Fields) -> str:
    """The voltage of a cell, which says how much is left, and what that means where it is little."""
    cells = health.get("battery_cells")
    if not cells:
        return ""
    each = battery["voltage"] / cells
    weak = f", NEARLY EMPTY (below {WEAK_CELL:g} V)" if each < WEAK_CELL else ""
    return f"; {each:.2f} V in each of {cells} cells{weak}"


def _health(fields: Fields) -> str:
    alive = "alive" if fields["is_alive"] else "NOT alive"
    motors = {True: "motors running", False: "motors stopped", None: "motors unknown"}[fields["motors_running"]]
    words = [alive, motors]
    if fields["error"]:
        words.append(f"ERROR: {fields['error']}")
    if fields["read_only"]:
        words.append(f"read only: {fields['read_only']}")
    if fields["note"]:
        words.append(fields["note"])
    return "; ".join(words)


def _open_endpoints(fields: Fields) -> str:
    """A warning; nothing where the bus asks who comes, as it should."""
    reachable = ", ".join(fields.get("open_endpoints", ()))
    return f"OPEN: everybody in the network may fly, at {reachable}" if reachable else ""


def _firmware(fields: Fields) -> str:
    return ", ".join(f"{board} {release}" for board, release in fields["firmware"].items()) or "not known yet"


def _link(fields: Fields) -> str:
    return f"{fields['condition']}: {fields['reason']} ({fields['port']}, {fields['baud']} baud)"


def _echo(fields: Fields) -> str:
    echo = fields["echo"]
    if echo["p50_ms"] is None:
        return "no link test answered yet"
    return f"p50 {echo['p50_ms']:.1f} ms, p99 {echo['p99_ms']:.1f} ms"


def _control(fields: Fields) -> str:
    lease = fields["lease"]
    held = "no client holds the lease" if lease is None else f"{lease['holder']} holds the lease"
    layout = fields["external_control"]
    trouble = f"{fields['trouble']}; " if fields.get("trouble") else ""
    return f"{trouble}{fields['phase']}; {held}; external control {layout or 'not possible'}"


def _hands(fields: Fields) -> str:
    return f"the pilot {fields['hands']}" if fields.get("hands") else ""


def _flight(fields: Fields) -> str:
    words = [_PLACES[fields["is_flying"]], f"GPS {fields['gps_mode']}"]
    words += [name.replace("_", " ") for name in _ALARMS if fields.get(name)]
    if fields["flying_time"] is not None:
        words.append(f"{fields['flying_time']:.0f} s in the air" if fields["is_flying"] else _flown(fields))
    return ", ".join(words)


def _flown(fields: Fields) -> str:
    return f"flew {fields['flying_time']:.0f} s"


_PLACES = {True: "flying", False: "on the ground", None: "in the air or on the ground: unknown"}
_ALARMS = ("emergency_landing", "battery_low", "rc_failsafe", "range_limit", "altitude_control", "manual_control")


def _attitude(fields: Fields) -> str:
    roll, pitch, yaw = (math.degrees(fields[axis]) for axis in ("roll", "pitch", "yaw"))
    return f"roll {roll:+.1f}°, pitch {pitch:+.1f}°, yaw {yaw:+.1f}° (heading {(90 - yaw) % 360:.0f}°)"


def _position(fields: Fields) -> str:
    height = fields["altitude_above_start"]
    words = "height unknown" if height is None else f"{height:.1f} m above start"
    text = f"{fields['latitude_deg']:.7f}, {fields['longitude_deg']:.7f}, {words}"
    if fields["home_distance"] is not None:
        text += f"; {fields['home_distance']:.1f} m from home"
    return text


def _battery(fields: Fields) -> str:
    text = f"{fields['voltage']:.1f} V"
    if fields["current"] is not None:
        text += f", {fields['current']:.1f} A"
    if fields["used_mah"] is not None:
        text += f", {fields['used_mah']:.0f} mAh used"
    return text + (", LOW" if fields["is_low"] else "")


def _gps(fields: Fields) -> str:
    if fields["satellites"] is None and fields["fix"] == "none":
        return "NO WORD FROM THE RECEIVER: satellites and position are not known"
    satellites = "?" if fields["satellites"] is None else fields["satellites"]
    return f"{satellites} satellites, position {fields['fix']}, {'usable' if fields['is_usable'] else 'not usable'}"


def _pilot(fields: Fields) -> str:
    return f"receiver {100 * fields['rc_quality']:.0f} %{'' if fields['has_signal'] else ', NO SIGNAL'}"


def _recording(fields: Fields) -> str:
    """A warning where something is not recorded; else how much is."""
    lost = f", {fields['lost']} LOST" if fields["lost"] else ""
    if fields["state"] == "recording":
        return f"{fields['entries']} entries, {fields['total_bytes'] / 1e6:.0f} MB{lost}"
    return f"NOT RECORDING ({fields['state']}): {fields['reason']}{lost}"


_LINES = (
    ("vehicle", "health", _health),
    ("bus", "health", _open_endpoints),
    ("firmware", "health", _firmware),
    ("link", "link/state", _link),
    ("round trip", "link/health", _echo),
    ("control", "control/status", _control),
    ("hands", "control/status", _hands),
    ("flight", "state/flight", _flight),
    ("attitude", "state/attitude", _attitude),
    ("position", "state/position", _position),
    ("battery", "state/battery", _battery),
    ("GPS", "state/gps", _gps),
    ("pilot", "state/pilot", _pilot),
    ("recording", "record/status", _recording),
)
