"""Pictures of how-to pages that are screens: what real commands print about files of this repository."""

from __future__ import annotations

import asyncio
import io
import os
import tempfile
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Final
from unittest.mock import patch

from rich.text import Span, Text

from lab.places import ROOT
from mkdaemon.cli.console import Console
from mkdaemon.cli.mkctl.log import info
from mkdaemon.cli.mkctl.settings import compare
from mkdaemon.cli.mkctl.sim_fault import faults
from mkdaemon.cli.mkctl.status import render
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import SettingsFile
from mkdaemon.reading import Reading, key_spec
from mkdaemon.record.entry import EntryKind, unpacked
from mkdaemon.record.reader import Recording
from mksim.boards.parameters import factory_set
from tools.screensvg import screen_svg

_RECORDINGS: Final = Path("tests/data/recordings")
_REVISION: Final = 106
"""Of FlightCtrl 2.12a, whose factory sets were recorded."""
_COLUMNS: Final = 100
"""Width of the screen of `mkctl status`."""


def status_picture(_root: Path) -> str:
    """Return `mkctl status` in a flight over the target: just before its holder gives the lease back, as SVG."""
    return _status("fc_over_target", "event/mode", "releasing")


def trouble_picture(_root: Path) -> str:
    """Return `mkctl status` when the cable has been pulled in flight, as SVG."""
    return _status("fc_replugged", "link/state", "absent")


def recording_picture(_root: Path) -> str:
    """Return what `mkctl log info` says of a recording, as SVG."""
    path = _RECORDINGS / "fc_sticks.mcap"
    with chdir(ROOT), _typed(f"mkctl log info {path}") as lines:
        info(path)
    return _screen(lines)


def settings_picture(_root: Path) -> str:
    """Return what `mkctl settings compare` finds between two factory sets, as SVG."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for slot, name in ((1, "fast.toml"), (3, "easy.toml")):
            parameters = ParameterSet.from_payload(factory_set(_REVISION, slot))
            Path(name).write_text(SettingsFile(parameters, slot, "2.12a").to_toml(), encoding="utf-8")
        with _typed("mkctl settings compare easy.toml fast.toml") as lines:
            asyncio.run(compare(Path("easy.toml"), Path("fast.toml")))
    return _screen(lines)


def faults_picture(_root: Path) -> str:
    """Return what `mkctl sim faults` lists, as SVG."""
    with _typed("mkctl sim faults") as lines:
        faults()
    return _screen(lines)


def _status(recording: str, key: str, word: str) -> str:
    """The screen just before a recorded value says this word under this key."""
    reading, now = Reading(), 0.0
    for entry in Recording(ROOT / _RECORDINGS / f"{recording}.mcap").entries(
        lambda facts: facts.kind is EntryKind.SAMPLE
    ):
        fields, spec = unpacked(entry.payload), key_spec(entry.suffix)
        now = entry.received
        if entry.suffix == key and word in fields.values():
            break
        if spec is not None and spec.fresh is not None and spec.carries is not None:
            reading.take(entry.suffix, spec.carries.model_validate(fields), now)
    else:
        msg = f"{recording}: nothing under {key} says {word}"
        raise ValueError(msg)
    with _typed("mkctl status --vehicle t") as lines:
        Console(width=_COLUMNS).print(render("t", reading.at(now)))
    return _screen(lines)


@contextmanager
def _typed(command: str) -> Iterator[list[Text]]:
    """What was typed, and then what is printed meanwhile; filled in at the end."""
    lines = [Text(f"$ {command}", spans=[Span(0, len(command) + 2, "bold")])]
    printed = io.StringIO()
    with patch.dict(os.environ), redirect_stdout(printed), redirect_stderr(io.StringIO()):
        os.environ.pop("FORCE_COLOR", None)  # rich would take the text for a terminal's
        yield lines
    lines += [Text(line.rstrip()) for line in printed.getvalue().splitlines()]


def _screen(lines: list[Text]) -> str:
    return screen_svg(lines, max(len(line.plain) for line in lines))
