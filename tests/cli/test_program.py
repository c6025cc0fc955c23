"""Command tables, errors and exit codes of both programs."""

from __future__ import annotations

import importlib
import io

import pytest
from cyclopts import App

from mkdaemon.cli import app as mkctl
from mkdaemon.cli.program import CommandEntry, build, run
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError
from mkdaemon.service import app as mkdaemon
from mkdaemon.service import bench

TABLES = [*mkctl.COMMANDS, *mkdaemon.COMMANDS, *bench.BENCHMARKS]


@pytest.mark.parametrize("entry", TABLES, ids=lambda entry: entry.target)
def test_every_command_of_the_tables_exists(entry):
    module, _, name = entry.target.partition(":")
    target = getattr(importlib.import_module(module), name)
    assert callable(target)
    if isinstance(target, App):
        assert target.name[0] == entry.name
    assert entry.help.endswith(".")


@pytest.mark.parametrize("program", [mkctl.app, mkdaemon.app], ids=["mkctl", "mkdaemon"])
def test_help_lists_every_command_without_importing_one(program, capsys):
    assert run(program, ["--help"]) == 0
    out = capsys.readouterr().out
    table = mkctl.COMMANDS if program is mkctl.app else mkdaemon.COMMANDS
    assert all(entry.name in out for entry in table)


def test_a_missing_module_breaks_no_other_command(capsys):
    app = build("x", "", [CommandEntry("gone", "mkdaemon.no_such:thing", ""), CommandEntry("len", "builtins:len", "")])
    assert run(app, ["--help"]) == 0
    out = capsys.readouterr().out
    assert "gone" not in out
    assert "len" in out


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError("a.toml:3: x: no"), 2),
        (MkError("it broke\nbadly"), 1),
        (CommandRejectedError("busy", "too much.", "Wait."), 1),
        (KeyboardInterrupt(), 130),
    ],
)
def test_errors_are_one_line_and_an_exit_code(error, code, capsys):
    app = App(name="prog")

    @app.default
    def fail() -> None:
        raise error

    assert run(app, []) == code
    err = capsys.readouterr().err
    assert len(err.splitlines()) == (0 if isinstance(error, KeyboardInterrupt) else 1)
    assert not err or err.startswith("prog: ")


def test_exit_codes_of_commands_pass_through():
    app = App(name="prog")

    @app.default
    def done() -> int:
        return 7

    assert run(app, []) == 7


@pytest.mark.parametrize("tokens", [["nonsense"], ["run", "--no-such-option"], ["run", "--log", "loud"]])
def test_wrong_usage_is_exit_code_2(tokens, capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    assert run(mkdaemon.app, tokens) == 2
