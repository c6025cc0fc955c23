"""`python -m lab files`: hostile files, given to every command that reads one."""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from lab.campaign import First
from lab.files.commands import READERS, Reader
from lab.files.mutations import LONG, REPEATED, SPECIAL, spoil
from lab.files.originals import Kind, originals
from lab.files.running import MOST_CPU, MOST_MEMORY, PATIENCE, Ended, prepare, run_forked
from lab.tables import show
from mkdaemon.cli.arguments import AsJson, Count
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, EXIT_WARNING

_CODES: Final = frozenset({EXIT_OK, EXIT_FAILURE, EXIT_CONFIG, EXIT_WARNING})
_LONGEST_WORD: Final = 4000
"""Of what a command says of a file [characters]."""
_CONTROLS: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""What a terminal acts on; but for a carriage return before a line feed there is none of it."""
DAEMON_TIME: Final = 8.0
"""A daemon that a file did not stop is told to end then [s]."""
PLACE: Final = "hostile"
"""Name of every file, before its suffix."""


Make = Callable[[Path], object]
"""Writes a file."""


def hostile_files(seeds: range) -> Iterator[tuple[Reader, str, Make]]:
    """All commands and files, each with what was done to it; the special ones first."""
    long = {f"long {number} {part[:20]!r}": part * (LONG // len(part)) for number, part in enumerate(REPEATED)}
    for reader in READERS:
        yield from ((reader, name, make) for name, make in SPECIAL.items())
        yield from ((reader, name, partial(Path.write_bytes, data=content)) for name, content in long.items())
        for seed in seeds:
            yield reader, f"seed {seed}", partial(_write_spoilt, reader.kind, seed)


def _write_spoilt(kind: Kind, seed: int, path: Path) -> None:
    path.write_bytes(spoil(kind, seed))


def try_file(reader: Reader, make: Make, goods: Path) -> tuple[Ended, list[str]]:
    """Run a command; returns how it ended and what is wrong with that.

    Args:
        reader: the command.
        make: writes its file.
        goods: folder of a good file of each kind.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder, parent = Path(temporary) / "o", Path(temporary) / "f"
        folder.mkdir()
        parent.mkdir()
        path = parent / f"{PLACE}{reader.kind}"
        make(path)
        places = {
            "file": path,
            "parent": parent,
            "folder": folder,
            "good": goods / f"good{reader.kind}",
            "picture": goods / f"good{Kind.PICTURE}",
            "camera": goods / f"good{Kind.CAMERA}",
        }
        words = [word.format(**places) for word in reader.words]
        is_daemon = reader.program == "mkdaemon" and words[0] == "run"
        ended = run_forked(reader.program, words, folder, end_after=DAEMON_TIME if is_daemon else None)
    return ended, faults_of(ended)


def faults_of(ended: Ended) -> list[str]:
    """What is wrong with how a command ended."""
    found = []
    if "Traceback" in ended.err or "Traceback" in ended.out:
        found.append(f"traceback: {_last_line(ended.err)}")
    elif ended.code not in _CODES:
        found.append(f"ended with {ended.code}")
    elif ended.code and not ended.err.strip() and not ended.out.strip():
        found.append("failed without a word")
    if ended.cpu > MOST_CPU:
        found.append(f"took {ended.cpu:.1f} s")
    elif ended.wall > PATIENCE:
        found.append(f"lasted {ended.wall:.1f} s")
    if ended.memory > MOST_MEMORY:
        found.append(f"took {ended.memory / 1e6:.0f} MB")
    if len(ended.err) > _LONGEST_WORD:
        found.append(f"said {len(ended.err)} characters")
    for text in (ended.err, ended.out):
        if (control := _CONTROLS.search(text.replace("\r\n", "\n"))) is not None:
            found.append(f"printed {control.group()!a}")
            break
    return found


def _last_line(text: str) -> str:
    places = re.findall(r'File ".*?/src/(\S+?)", line (\d+)', text)
    lines = [line for line in text.splitlines() if line.strip()]
    place = f" at {places[-1][0]}:{places[-1][1]}" if places else ""
    return (lines[-1][:150] if lines else "") + place


def good_files(folder: Path) -> None:
    """Write a good file of each kind."""
    for kind in Kind:
        (folder / f"good{kind}").write_bytes(originals(kind)[0])


def main(
    *,
    seeds: Annotated[Count, Parameter(help="Spoilt files for each command.")] = 30,
    first: First = 0,
    as_json: AsJson = False,
) -> int:
    """Give hostile files to every command that reads one; exit code 1 if one of them breaks a limit.

    No traceback, an exit code of ours, a word about what is wrong, at most 5 s of processor time and 300 MB, and
    nothing that a terminal acts on. With 30 seeds it takes about fifteen minutes.
    """
    prepare()
    os.environ["MK_CONNECT"] = "tcp/127.0.0.1:9"
    wrong: list[dict[str, Any]] = []
    files, longest, largest = 0, 0.0, 0
    with tempfile.TemporaryDirectory() as goods:
        good_files(Path(goods))
        for reader, name, make in hostile_files(range(first, first + seeds)):
            files += 1
            ended, faults = try_file(reader, make, Path(goods))
            longest, largest = max(longest, ended.cpu), max(largest, ended.memory)
            if faults:
                wrong.append({"command": reader.name, "file": name, "faults": faults})
                print(json.dumps(wrong[-1]), file=sys.stderr, flush=True)
    found = {
        "what": "hostile files",
        "files": files,
        "commands": len(READERS),
        "cpu_max_s": round(longest, 2),
        "memory_max_mb": round(largest / 1e6),
        "wrong": wrong,
        "holds": not wrong,
    }
    return show([found], ("what",), as_json=as_json)
