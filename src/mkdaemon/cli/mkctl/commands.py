"""The commands of `mkctl`."""

from __future__ import annotations

from typing import Final

from mkdaemon.cli.listing import CommandEntry

_LOOK, _FLY, _CAMERAS, _RECORD, _BOARDS, _SIMULATOR = "Look", "Fly", "Cameras", "Recordings", "Boards", "Simulator"
_MKCTL: Final = "mkdaemon.cli.mkctl"

COMMANDS: Final = (
    CommandEntry("status", f"{_MKCTL}.status:status", "The aircraft, the link and the lease, on one screen.", _LOOK),
    CommandEntry("view", f"{_MKCTL}.view:view", "The aircraft in a browser, live or from a recording.", _LOOK),
    CommandEntry("top", f"{_MKCTL}.top:top", "A vehicle on one screen of a terminal, live, with keys.", _LOOK),
    CommandEntry("watch", f"{_MKCTL}.values:watch", "Values as they come, for example `watch 'state/**'`.", _LOOK),
    CommandEntry("get", f"{_MKCTL}.values:get", "Last values with their age, for example `get rx/nc/osd`.", _LOOK),
    CommandEntry("health", f"{_MKCTL}.health:health", "The link, live: state, round trips, losses, streams.", _LOOK),
    CommandEntry("linktest", f"{_MKCTL}.linktest:linktest", "Measure the line under load. Motors off.", _LOOK),
    CommandEntry("release", f"{_MKCTL}.release:release", "Give the aircraft back to the pilot, now.", _FLY),
    CommandEntry("abort", f"{_MKCTL}.manoeuvres:abort", "Stop the manoeuvre and hold; the flight goes on.", _FLY),
    CommandEntry("preflight", f"{_MKCTL}.preflight:preflight", "Make every check before a flight.", _FLY),
    CommandEntry("take-off", f"{_MKCTL}.manoeuvres:take_off", "Take off and hold: `take-off 2`.", _FLY),
    CommandEntry("hold", f"{_MKCTL}.manoeuvres:hold", "Hold the present place over the target in sight.", _FLY),
    CommandEntry("goto", f"{_MKCTL}.manoeuvres:goto", "Fly to a place over the target, or at home.", _FLY),
    CommandEntry("land", f"{_MKCTL}.manoeuvres:land", "Land on the target in sight.", _FLY),
    CommandEntry("fly", f"{_MKCTL}.script:fly", "Fly the steps of a file: `fly SCRIPT.toml`.", _FLY),
    CommandEntry("teleop", f"{_MKCTL}.teleop.command:teleop", "Fly with a gamepad or the keyboard.", _FLY),
    CommandEntry("velocity", f"{_MKCTL}.manoeuvres:velocity", "Fly at a velocity against the target.", _FLY),
    CommandEntry("attitude", f"{_MKCTL}.manoeuvres:attitude", "Fly by attitude and thrust.", _FLY),
    CommandEntry("stick", f"{_MKCTL}.manoeuvres:stick", "Stream stick offsets for some seconds.", _FLY),
    CommandEntry("lease", f"{_MKCTL}.lease:app", "Take, give back or show the right to fly.", _FLY),
    CommandEntry("camera", f"{_MKCTL}.camera:camera", "What a camera sees, how well, what to change.", _CAMERAS),
    CommandEntry("log", f"{_MKCTL}.log:app", "Recordings: record, play, export, report, list, repair.", _RECORD),
    CommandEntry("settings", f"{_MKCTL}.settings:app", "Parameter sets: show, backup, write, restore.", _BOARDS),
    CommandEntry("waypoints", f"{_MKCTL}.waypoints:app", "Missions of the NaviCtrl: upload, fly, home.", _BOARDS),
    CommandEntry("board", f"{_MKCTL}.board:app", "Mixer, motors, parameters, menus, any request.", _BOARDS),
    CommandEntry("sim", f"{_MKCTL}.sim_fault:app", "Faults of a running simulator.", _SIMULATOR),
    CommandEntry(
        "do", f"{_MKCTL}.verbforms:app", "Any verb of the daemon, with help and limits.", _BOARDS, is_shown=False
    ),
)
"""Every command, those most used first; a further one is one line here and its module."""

ABOUT: Final = """Look at a MikroKopter, fly it and set it up, through a running mkdaemon.

Every command takes, before it or behind it, `--vehicle NAME` (default mk1, or MK_VEHICLE), `--connect ENDPOINT`
(default tcp/127.0.0.1:7447, or MK_CONNECT) and `--json` for one JSON object a line. A refusal names its token, the
reason and the fix.

First steps: `mkctl status`, `mkctl watch 'state/**'`, `mkctl health`. Completion by Tab: `mkctl --install-completion`.
"""

BOARD: Final = {
    "mixer": "mkdaemon.cli.mkctl.mixer:app",
    "motors": "mkdaemon.cli.mkctl.motors:app",
    "motor-controllers": "mkdaemon.cli.mkctl.motor_controllers:app",
    "parameters": "mkdaemon.cli.mkctl.ncparam:app",
    "labels": "mkdaemon.cli.mkctl.streams:labels",
    "display": "mkdaemon.cli.mkctl.display:display",
    "rates": "mkdaemon.cli.mkctl.streams:rates",
    "send": "mkdaemon.cli.mkctl.send:app",
}
"""Commands and their functions or groups, each imported when it is used."""

GROUPS: Final = frozenset(
    {entry.name for entry in COMMANDS if entry.target.endswith(":app")}
    | {f"board {name}" for name, target in BOARD.items() if target.endswith(":app")}
)
"""Commands whose name has a further word, for example `lease take`, `board mixer read`."""
