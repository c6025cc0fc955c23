"""`mkctl`: a client of the daemon. Every command is a Zenoh client like any other program's."""

from __future__ import annotations

import sys
from collections.abc import Container, Sequence
from typing import Final, NoReturn

from mkdaemon.cli.program import CommandEntry
from mkdaemon.cli.program import build as _build
from mkdaemon.cli.program import main as _main

_WITH_VALUE: Final = frozenset({"--vehicle", "--connect", "--zenoh-file"})
_FLAGS: Final = frozenset({"--json"})


def move_behind_command(tokens: Sequence[str], groups: Container[str]) -> list[str]:
    """Move options that stand before the command, or inside its name, behind it.

    Args:
        tokens: the command line without the program's name.
        groups: commands whose name has a second word, for example `lease take`.

    Returns:
        The same words, the command first; without a command, what is left without these options.
    """
    left = list(tokens)
    options: list[str] = []
    command: list[str] = []
    while left and (not command or (len(command) == 1 and command[0] in groups)):
        name, equals, _ = left[0].partition("=")
        if name in _WITH_VALUE and not equals and len(left) > 1:
            options += [left.pop(0), left.pop(0)]
        elif name in _WITH_VALUE | _FLAGS:
            options.append(left.pop(0))
        elif left[0].startswith("-"):
            break
        else:
            command.append(left.pop(0))
    return [*command, *options, *left] if command else left


_LOOK, _FLY, _EYES, _RECORD, _BOARDS, _SIMULATOR = "Look", "Fly", "Eyes", "Recordings", "Boards", "Simulator"

COMMANDS: Final = (
    CommandEntry(
        "status", "mkdaemon.cli.mkctl.status:status", "The aircraft, the link and who flies, on one screen.", _LOOK
    ),
    CommandEntry("view", "mkdaemon.cli.mkctl.view:view", "The aircraft in a browser, live or from a recording.", _LOOK),
    CommandEntry("top", "mkdaemon.cli.mkctl.top:top", "A vehicle on one screen of a terminal, live, with keys.", _LOOK),
    CommandEntry(
        "watch", "mkdaemon.cli.mkctl.values:watch", "Values as they come, for example `watch 'state/**'`.", _LOOK
    ),
    CommandEntry(
        "get", "mkdaemon.cli.mkctl.values:get", "Last values with their age, for example `get rx/nc/osd`.", _LOOK
    ),
    CommandEntry(
        "health", "mkdaemon.cli.mkctl.health:health", "The link, live: state, round trips, losses, streams.", _LOOK
    ),
    CommandEntry(
        "linktest",
        "mkdaemon.cli.mkctl.linktest:linktest",
        "Measure the line under load, with advice. Motors off.",
        _LOOK,
    ),
    CommandEntry("release", "mkdaemon.cli.mkctl.release:release", "Let go of the aircraft, now, whoever flies.", _FLY),
    CommandEntry("preflight", "mkdaemon.cli.mkctl.preflight:preflight", "Make every check before a flight.", _FLY),
    CommandEntry(
        "take-off",
        "mkdaemon.cli.mkctl.manoeuvres:take_off",
        "Take off from the target and hold over it: `take-off 2`.",
        _FLY,
    ),
    CommandEntry(
        "hold", "mkdaemon.cli.mkctl.manoeuvres:hold", "Hold the present place over the target in sight.", _FLY
    ),
    CommandEntry(
        "goto", "mkdaemon.cli.mkctl.manoeuvres:goto", "Fly to a place over the target in sight: `goto 0 0 2`.", _FLY
    ),
    CommandEntry("land", "mkdaemon.cli.mkctl.manoeuvres:land", "Land on the target in sight.", _FLY),
    CommandEntry("fly", "mkdaemon.cli.mkctl.script:fly", "Fly the steps of a file: `fly SCRIPT.toml`.", _FLY),
    CommandEntry("abort", "mkdaemon.cli.mkctl.manoeuvres:abort", "Stop the manoeuvre and hold, whoever flies.", _FLY),
    CommandEntry(
        "stick", "mkdaemon.cli.mkctl.manoeuvres:stick", "Fly by sticks: stream stick offsets for some seconds.", _FLY
    ),
    CommandEntry(
        "teleop", "mkdaemon.cli.mkctl.teleop.command:teleop", "Fly with a gamepad or the keyboard: `teleop`.", _FLY
    ),
    CommandEntry(
        "velocity", "mkdaemon.cli.mkctl.manoeuvres:velocity", "Fly at a velocity against the target in sight.", _FLY
    ),
    CommandEntry("attitude", "mkdaemon.cli.mkctl.manoeuvres:attitude", "Fly by attitude and thrust.", _FLY),
    CommandEntry("lease", "mkdaemon.cli.mkctl.lease:app", "Take, give back or show the right to fly.", _FLY),
    CommandEntry("navi", "mkdaemon.cli.mkctl.navi:app", "The NaviCtrl's own modes: goto, route, home, status.", _FLY),
    CommandEntry("gains", "mkdaemon.cli.mkctl.gains:gains", "Model, gains and margins of the horizontal loop.", _FLY),
    CommandEntry(
        "stop", "mkdaemon.cli.mkctl.manoeuvres:stop", "Stop the motors, where the firmware can be asked.", _FLY
    ),
    CommandEntry("camera", "mkdaemon.cli.mkctl.camera:camera", "What a camera sees, how well, what to change.", _EYES),
    CommandEntry("target", "mkdaemon.cli.mkctl.target:app", "A print judged by a photograph: `target check`.", _EYES),
    CommandEntry("log", "mkdaemon.cli.mkctl.log:app", "Recordings: list, check, recover, cut, merge, mark.", _RECORD),
    CommandEntry(
        "record", "mkdaemon.cli.mkctl.record:record", "Record what all vehicles put on the bus, into files.", _RECORD
    ),
    CommandEntry("play", "mkdaemon.cli.mkctl.play:play", "Show a recording to clients, at any speed.", _RECORD),
    CommandEntry(
        "report",
        "mkdaemon.cli.mkctl.report:report",
        "A flight as one page, out of a recording: `report FILE`.",
        _RECORD,
    ),
    CommandEntry(
        "export", "mkdaemon.cli.mkctl.export:export", "A recording as tables, a track or a ROS 2 bag.", _RECORD
    ),
    CommandEntry(
        "settings", "mkdaemon.cli.mkctl.settings:app", "Parameter sets: show, backup, compare, write, restore.", _BOARDS
    ),
    CommandEntry(
        "waypoints", "mkdaemon.cli.mkctl.waypoints:app", "Missions: upload, read, verify, clear, convert.", _BOARDS
    ),
    CommandEntry("route", "mkdaemon.cli.mkctl.verbforms:route", "The NaviCtrl's list in flight: start, end.", _BOARDS),
    CommandEntry("rates", "mkdaemon.cli.mkctl.streams:rates", "Streams at an interval: `rates osd 100ms`.", _BOARDS),
    CommandEntry(
        "send", "mkdaemon.cli.mkctl.send:app", "Any MikroKopter request, with help, units and limits.", _BOARDS
    ),
    CommandEntry("motors", "mkdaemon.cli.mkctl.motors:app", "Motor test, propellers off.", _BOARDS),
    CommandEntry("mixer", "mkdaemon.cli.mkctl.mixer:app", "The FlightCtrl's mixer table.", _BOARDS),
    CommandEntry(
        "motor-controllers",
        "mkdaemon.cli.mkctl.motor_controllers:app",
        "Configuration of the motor controllers.",
        _BOARDS,
    ),
    CommandEntry("nc-param", "mkdaemon.cli.mkctl.ncparam:app", "Parameters of the NaviCtrl.", _BOARDS),
    CommandEntry("display", "mkdaemon.cli.mkctl.display:display", "A board's own 4x20 menu, live, with keys.", _BOARDS),
    CommandEntry("labels", "mkdaemon.cli.mkctl.streams:labels", "Names of a board's analog channels.", _BOARDS),
    CommandEntry("do", "mkdaemon.cli.mkctl.verbforms:app", "Any verb of the daemon, with help and limits.", _BOARDS),
    CommandEntry("sim", "mkdaemon.cli.mkctl.sim_fault:app", "Faults of a running simulator.", _SIMULATOR),
)
"""Every command, those most used first; a further one is one line here and its module."""

ABOUT: Final = """Look at a MikroKopter, fly it and set it up, through a running mkdaemon.

Every command takes, before it or behind it, `--vehicle NAME` (default mk1, or MK_VEHICLE), `--connect ENDPOINT`
(default tcp/127.0.0.1:7447, or MK_CONNECT) and `--json` for one JSON object a line. A refusal names its token, the
reason and the fix.

First steps: `mkctl status`, `mkctl watch 'state/**'`, `mkctl health`. Completion by Tab: `mkctl --install-completion`.
"""

app = _build("mkctl", ABOUT, COMMANDS)


def main() -> NoReturn:
    """Entry point."""
    groups = {entry.name for entry in COMMANDS if entry.target.endswith(":app")}
    _main("mkctl", ABOUT, COMMANDS, move_behind_command(sys.argv[1:], groups))


if __name__ == "__main__":
    main()
