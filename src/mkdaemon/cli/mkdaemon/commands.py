"""The commands of `mkdaemon`."""

from __future__ import annotations

from typing import Final

from mkdaemon.cli.listing import CommandEntry

COMMANDS: Final = (
    CommandEntry("run", "mkdaemon.cli.mkdaemon.run:run", "The daemon: serial line, link check, control, bus.", "Fly"),
    CommandEntry("sim", "mkdaemon.cli.mkdaemon.extraprograms:sim", "A simulated aircraft on a pseudo terminal.", "Fly"),
    CommandEntry(
        "demo", "mkdaemon.cli.mkdaemon.extraprograms:demo", "A complete simulated flight: a first look.", "Fly"
    ),
    CommandEntry(
        "doctor", "mkdaemon.cli.mkdaemon.doctor:doctor", "Check this machine: port, permissions, bus, camera.", "Fly"
    ),
    CommandEntry(
        "gateway", "mkdaemon.cli.mkdaemon.gateway:app", "MAVLink, ROS 2 or Foxglove beside the daemon.", "Fly"
    ),
    CommandEntry(
        "config",
        "mkdaemon.cli.mkdaemon.configfile:app",
        "Check, show, explain and begin a configuration file.",
        "Set up",
    ),
    CommandEntry(
        "install-service",
        "mkdaemon.cli.mkdaemon.service:install_service",
        "Let systemd start daemon, recorder, gateways.",
        "Set up",
    ),
    CommandEntry(
        "security",
        "mkdaemon.cli.mkdaemon.security.securing:app",
        "Certificates: which clients may look, fly and record.",
        "Set up",
    ),
    CommandEntry(
        "calibrate", "mkdaemon.cli.mkdaemon.calibrate:app", "Print targets and boards; calibrate a camera.", "Camera"
    ),
    CommandEntry(
        "replay", "mkdaemon.cli.mkdaemon.replay:replay", "A recording through today's code, compared.", "Offline"
    ),
    CommandEntry(
        "decode", "mkdaemon.cli.mkdaemon.decode:decode", "Recorded bytes to one JSON object a frame.", "Offline"
    ),
    CommandEntry(
        "detect", "mkdaemon.cli.mkdaemon.detect:detect", "Tags and their poses in images and videos.", "Offline"
    ),
    CommandEntry(
        *("schema", "mkdaemon.cli.mkdaemon.schema:schema", "The message table, or payloads' schemas, as JSON."),
        *("Offline", False),
    ),
)
"""Every command; a further one is one line here and its module."""

ABOUT: Final = """Ground and companion software for MikroKopter aircraft.

`mkdaemon run --port /dev/ttyUSB0` shows every frame on the line as a typed Zenoh key under `mk/mk1/`; look at it with
`mkctl status`. No aircraft at hand: `mkdaemon demo`.

Exit codes: 0 as asked, 1 failed while running, 2 wrong configuration or usage. Completion by Tab:
`mkdaemon --install-completion`.
"""
