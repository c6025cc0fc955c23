"""`mkdaemon bench`: each benchmark is a module `mkdaemon.bench.<name>` with a `main`, imported when it is used."""

from __future__ import annotations

from typing import Final

from mkdaemon.cli.program import CommandEntry, build

BENCHMARKS: Final = (
    CommandEntry("protocol", "mkdaemon.bench.protocol:main", "Decoding: frames a second, against pymavlink."),
    CommandEntry("link", "mkdaemon.bench.link:main", "The link under load: losses, latencies, recovery."),
    CommandEntry("vision", "mkdaemon.bench.vision:main", "Detection: rate, accuracy, latency."),
    CommandEntry("stories", "mkdaemon.bench.stories:main", "Lost clients, pulled cables, races: the safety stories."),
    CommandEntry("procedures", "mkdaemon.bench.procedures:main", "Uploads and backups over a line that loses bytes."),
    CommandEntry("flight", "mkdaemon.bench.flight:main", "The simulated flight against the plant's figures."),
    CommandEntry("figures", "mkdaemon.bench.figures:main", "Every plot of docs/figures."),
)

app = build("bench", "Measure this machine. With `--json` the last line is one JSON object.", BENCHMARKS)
