"""Options of every command before the command."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mkdaemon.cli.mkctl.app import move_behind_command

GROUPS = {"lease", "sim"}
MKCTL = Path(sys.executable).with_name("mkctl")


@pytest.mark.parametrize(
    ("typed", "moved"),
    [
        ("status", "status"),
        ("--vehicle mk2 status", "status --vehicle mk2"),
        ("--vehicle=mk2 --json status", "status --vehicle=mk2 --json"),
        ("--connect tcp/a:1 --zenoh-file f get state/* --json", "get --connect tcp/a:1 --zenoh-file f state/* --json"),
        ("--json lease take --ttl 2", "lease take --json --ttl 2"),
        ("lease --vehicle mk2 take --ttl 2", "lease take --vehicle mk2 --ttl 2"),
        ("--json lease --help", "lease --json --help"),
        ("--vehicle mk2 --help", "--help"),
        ("--vehicle mk2", ""),
        ("--vehcle mk2 status", "--vehcle mk2 status"),
        ("stick --throttle -5 --vehicle mk2", "stick --throttle -5 --vehicle mk2"),
        ("", ""),
    ],
)
def test_options_move_behind_the_command(typed, moved):
    assert " ".join(move_behind_command(typed.split(), GROUPS)) == moved


def mkctl(*arguments):
    command = [sys.executable, "-m", "mkdaemon.cli.mkctl.app", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_mkctl_takes_the_vehicle_before_the_command():
    done = mkctl("--vehicle", "Mk 1", "lease", "show")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "mkctl: --vehicle 'Mk 1': a name has lower-case letters, digits, - and _\n"


def test_a_misspelt_command_is_answered_without_importing_the_others():
    code = (
        "import sys; from mkdaemon.cli.mkctl.app import app; from mkdaemon.cli.program import run; "
        "code = run(app, ['statsu']); print(code, len([name for name in sys.modules if name.startswith('mkdaemon')]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    code, modules = map(int, done.stdout.split())
    assert (code, modules < 14) == (2, True)
    assert done.stderr == 'mkctl: Unknown command "statsu". Did you mean "status"? See `mkctl --help`.\n'


@pytest.mark.parametrize("words", ["mkctl --help", "mkdaemon --help", "mkctl --vehicle mk2 --help"])
def test_the_list_of_commands_fits_80_columns_and_needs_no_library(words):
    program, *_ = words.split()
    code = (
        f"import sys; sys.argv = {words.split()!r}; from mkdaemon.cli.entry import {program} as run\n"
        "import atexit; found = {'rich', 'zenoh', 'pydantic'}.intersection\n"
        "atexit.register(lambda: print(*found(sys.modules), file=sys.stderr)); run()"
    )
    narrow = os.environ | {"COLUMNS": "80"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=narrow)
    assert done.stderr == "\n"
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    table = importlib.import_module(f"mkdaemon.cli.{program}.commands").COMMANDS
    listed = [line.split()[0] for line in lines if line.startswith("  ") and line[2] != " "]
    assert listed == [entry.name for entry in table if entry.is_shown]


def test_a_list_that_no_one_reads_to_its_end_is_no_error():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(["mkctl"], executable=MKCTL, stdout=write, stderr=subprocess.PIPE, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("words", [["fly"], ["calibrate", "mount"]])
def test_the_help_of_a_command_needs_no_library_and_fits_its_screen(words):
    program = "mkdaemon" if words[:1] == ["calibrate"] else "mkctl"
    code = (
        f"import sys; sys.argv = {[program, *words, '--help']!r}\n"
        f"from mkdaemon.cli.entry import {program}; {program}()\n"
        "print(*({'cyclopts', 'rich', 'pydantic', 'asyncio'} & set(sys.modules)), file=sys.stderr)"
    )
    call, narrow = [sys.executable, "-c", code], {"COLUMNS": "60", "PYTHONIOENCODING": "ascii"}
    ended = subprocess.run(call, capture_output=True, text=True, check=True, env=os.environ | narrow)
    assert ended.stdout.startswith(f"Usage: {' '.join((program, *words))}")
    assert words != ["fly"] or "Fly the steps of a TOML file one after the other" in ended.stdout.replace("\n", " ")
    assert max(map(len, ended.stdout.splitlines())) <= 60
    assert ended.stdout.isascii()
    assert ended.stderr in ("", "\n")
