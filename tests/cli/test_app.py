"""Options before the command, lists and helps, old names of commands, and where completion is installed."""

from __future__ import annotations

import importlib
import os
import shlex
import subprocess
import sys

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkctl.app import move_behind_command
from mkdaemon.cli.mkctl.commands import ABOUT, COMMANDS
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import COMPLETION, EXIT_CONFIG, build, run
from mkdaemon.cli.renamed import RENAMED

GROUPS = {"lease", "sim"}


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


def test_the_help_of_a_command_needs_no_library_and_fits_its_screen():
    program, words = "mkdaemon", ["calibrate", "mount"]
    code = (
        f"import sys; sys.argv = {[program, *words, '--help']!r}\n"
        f"from mkdaemon.cli.entry import {program}; {program}()\n"
        "print(*({'cyclopts', 'rich', 'pydantic', 'asyncio'} & set(sys.modules)), file=sys.stderr)"
    )
    call, narrow = [sys.executable, "-c", code], {"COLUMNS": "60", "PYTHONIOENCODING": "ascii"}
    ended = subprocess.run(call, capture_output=True, text=True, check=True, env=os.environ | narrow)
    assert ended.stdout.startswith(f"Usage: {' '.join((program, *words))}")
    assert max(map(len, ended.stdout.splitlines())) <= 60
    assert ended.stdout.isascii()
    assert ended.stderr in ("", "\n")


PROGRAMS = {"mkctl": mkctl, "mkdaemon": mkdaemon}
ROWS = [(program, old, new) for program, table in RENAMED.items() for old, new in table.items()]


@pytest.mark.parametrize(("program", "old", "new"), ROWS)
def test_an_old_name_is_answered_with_the_new_one_which_exists_and_nothing_is_done(program, old, new, capsys):
    assert run(PROGRAMS[program], [*shlex.split(old), "--help"]) == EXIT_CONFIG
    told = capsys.readouterr()
    assert told.out == "" and len(told.err.splitlines()) == 1
    assert f"`{program} {old}` is now `" in told.err and new in told.err
    words = shlex.split(new.replace(",", " and ").split(" and ")[0])
    app = PROGRAMS[words.pop(0) if words[0] == "mkdaemon" else program]
    for word in words:
        if not word.startswith("-") and app.default_command is None:
            app = app[word]
    app = PROGRAMS[program]
    *groups, last = shlex.split(old)
    for word in groups:
        if word not in app:
            return
        app = app[word]
    assert last not in app


def test_the_startup_file_is_changed_where_no_other_file_was_asked_for(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    program = build("mkctl", ABOUT, COMMANDS[:1], chosen=COMPLETION)
    assert run(program, [COMPLETION, "--shell", "bash"]) == 0
    script = tmp_path / ".local" / "share" / "bash-completion" / "completions" / "mkctl"
    assert script.is_file()
    assert str(script) in (tmp_path / ".bashrc").read_text()
    assert "mkctl completes commands" in capsys.readouterr().out
