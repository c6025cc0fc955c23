"""`python -m lab`: each campaign is a module with a `main`, imported when it is used."""

from __future__ import annotations

import os
import sys
from typing import Final

import structlog

from mkdaemon.cli.listing import CommandEntry
from mkdaemon.cli.program import build, main

CAMPAIGNS: Final = (
    CommandEntry("protocol", "lab.protocol:main", "Decoding: frames a second."),
    CommandEntry("link", "lab.link.main:main", "The link under load: losses, latencies, recovery."),
    CommandEntry("linktest", "lab.linktest:main", "Whether `mkctl linktest` finds what was put into a line."),
    CommandEntry("vision", "lab.vision.main:main", "Detection: rate, accuracy, latency."),
    CommandEntry("paired", "lab.vision.paired:main", "Images of every kind, a row each, to compare two trees."),
    CommandEntry(
        "stories", "lab.stories.main:main", "Lost clients and pads, cut lines, standstills: the safety stories."
    ),
    CommandEntry("procedures", "lab.procedures:main", "Uploads and backups over a line that loses bytes."),
    CommandEntry("attack", "lab.attack.main:main", "Killed, frozen, ended and flooded in flight; the guard killed."),
    CommandEntry("fuzz", "lab.fuzz.main:main", "Nonsense for a running daemon, its bus, and the flight core."),
    CommandEntry("fleet", "lab.fleet:main", "Three aircraft on a router; the link of one is cut in flight."),
    CommandEntry("files", "lab.files.main:main", "Hostile files, given to every command that reads one."),
    CommandEntry("kills", "lab.kills:main", "kill -9 of mkctl and of the daemon during backups and restores."),
    CommandEntry("control", "lab.control.main:main", "Hover, steps and landings of estimator and autopilot."),
    CommandEntry("fly", "lab.fly:main", "The whole daemon holds over a target, rendered camera, in real time."),
    CommandEntry(
        "demo", "lab.demo:main", "Many demonstrations: how many finish; the longest holes in attitude and pose."
    ),
    CommandEntry("room", "lab.room:main", "Flights from pad to pad over surveyed tags: where they land."),
    CommandEntry("paths", "lab.paths:main", "Figures of eight over surveyed tags: how far the aircraft is from them."),
    CommandEntry("survey", "lab.survey:main", "Maps of tags: how far each is off, and who is named."),
    CommandEntry("hil", "lab.hil.main:main", "Genuine firmware flies the same scenes as the simulated boards."),
    CommandEntry("record", "lab.record.main:main", "Recording: what it costs, kills, disks that fail."),
    CommandEntry("gateways", "lab.gateways:main", "Gateways: what they add in time, and what they cost."),
    CommandEntry("view", "lab.view:main", "The page of `mkctl view`: what it costs the daemon."),
    CommandEntry("mutants", "lab.mutants.main:main", "Whether a test notices when the code that decides is changed."),
    CommandEntry("compare", "lab.compare:main", "Two results, or two trees, flight by flight."),
    CommandEntry("positions", "lab.positions:main", "Flights by motion capture, and with its faults."),
    CommandEntry("wrong-sources", "lab.wrongsources:main", "Sources of poses that go wrong, alone or beside an eye."),
    CommandEntry("figures", "lab.figures:main", "The picture of docs/figures that is rendered."),
)

ABOUT: Final = """Measure this machine. With `--json` the last line is one JSON object.

`python -m lab CAMPAIGN --help` says what a campaign does and how long it takes.
"""

app = build("lab", ABOUT, CAMPAIGNS)

if __name__ in {"__main__", "__mp_main__"}:  # and in processes that a campaign starts: stdout may be JSON
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))

if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in the daemon
    main("lab", ABOUT, CAMPAIGNS)
