"""`mkdaemon replay`: a recording's bytes, requests and images through today's code, compared with what was recorded."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.errors import ConfigError


def replay(
    files: Annotated[list[Path], Parameter(name="FILE", consume_multiple=True)],
    /,
    *,
    verify: bool = False,
    tolerances: bool = False,
    config: Annotated[Path | None, Parameter(name=["--config", "-c"])] = None,
    as_json: AsJson = False,
) -> int:
    """Run what went into a recorded daemon through today's code, and compare what comes out.

    Bytes of the line, requests, setpoints and images come at their recorded times, in virtual time: link, translation,
    eyes, estimator and flight core do what they would do today. Nothing is opened: no port, no bus, no camera. Every
    published value is compared with the recorded one; what may differ, by how much and why, `--tolerances` shows.
    Exit codes: 0 no difference, 1 differences, 2 the recording cannot be replayed.

    Example: mkdaemon replay flight.mcap --verify

    Args:
        files: Recording of the daemon's black box, all parts from the first on.
        verify: Compare, and report every key that differs.
        tolerances: Only show what may differ.
        config: Configuration to fly with, in place of the recorded one.
        as_json: Print one JSON object in place of text.

    Raises:
        MkError: a file cannot be opened.
        ConfigError: a file is not a recording of a black box, or not its beginning.
    """
    from mkdaemon.config.reader import load
    from mkdaemon.replay.report import verify as verify_recording
    from mkdaemon.replay.tolerances import RULES

    if tolerances:
        for rule in RULES:
            print(f"{rule.key:18} {rule.field:24} {rule.tolerance}: {rule.why}")
        return EXIT_OK
    if not verify:
        msg = "say what for: --verify compares with the recording; `mkctl log play FILE` shows it to clients"
        raise ConfigError(msg)
    _be_quiet()
    report = verify_recording(files, None if config is None else load(config, {}))
    if as_json:
        print(json_line(report.as_map()))
    else:
        for line in report.lines():
            print(line)
    sys.stdout.flush()
    return EXIT_OK if report.is_equal else EXIT_FAILURE


def _be_quiet() -> None:
    """What the replayed daemon logs is no news."""
    import structlog

    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
