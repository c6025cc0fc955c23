"""Command tables, errors and exit codes of both programs."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys

import pytest
from cyclopts import App

from lab.__main__ import CAMPAIGNS
from mkdaemon.cli.listing import CommandEntry
from mkdaemon.cli.mkctl import app as mkctl
from mkdaemon.cli.mkdaemon import app as mkdaemon
from mkdaemon.cli.program import build, run
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError

TABLES = [*mkctl.COMMANDS, *mkdaemon.COMMANDS, *CAMPAIGNS]


@pytest.mark.parametrize("entry", TABLES, ids=lambda entry: entry.target)
def test_every_command_of_the_tables_exists(entry):
    module, _, name = entry.target.partition(":")
    target = getattr(importlib.import_module(module), name)
    assert callable(target)
    if isinstance(target, App):
        assert target.name[0] == entry.name
    assert entry.help.endswith(".")


def test_a_group_that_is_asked_of_cyclopts_shows_the_first_line_of_each_command(capsys):
    assert run(mkctl.app, ["log", "--help"]) == 0
    assert "Write a recording for other programs." in capsys.readouterr().out


def test_a_missing_module_breaks_no_other_command():
    app = build("x", "", [CommandEntry("gone", "mkdaemon.no_such:thing", ""), CommandEntry("len", "builtins:len", "")])
    assert ("gone" in app, "len" in app) == (False, True)


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (ConfigError("a.toml:3: x: no"), 2, "prog: a.toml:3: x: no\n"),
        (MkError("it broke\nbadly"), 1, "prog: it broke badly\n"),
        (CommandRejectedError("busy", "too much.", "Wait."), 1, "prog: busy: too much. Wait.\n"),
        (TimeoutError("not within 3 s"), 1, "prog: not within 3 s\n"),
        (TimeoutError(), 1, "prog: it took too long\n"),
        (KeyboardInterrupt(), 130, ""),
        (None, 7, ""),
    ],
)
def test_errors_are_one_line_and_an_exit_code_and_codes_of_commands_pass_through(error, code, says, capsys):
    app = App(name="prog")

    @app.default
    def end() -> int:
        if error is not None:
            raise error
        return 7

    assert run(app, []) == code
    assert capsys.readouterr().err == says


@pytest.mark.parametrize(
    ("tokens", "says", "points_to"),
    [
        (["rnu"], 'Unknown command "rnu". Did you mean "run"?', "mkdaemon --help"),
        (["run", "--prot", "x"], "Did you mean --port?", "mkdaemon run --help"),
        (["run", "--log", "loud"], '"loud" for --log', "mkdaemon run --help"),
        (["decode"], "`mkdaemon decode` needs FILE.", "mkdaemon decode --help"),
        (["run", "--port"], "--port needs a value.", "mkdaemon run --help"),
        (
            ["config", "--json"],
            "`mkdaemon config` needs check, show, explain or new before --json.",
            "mkdaemon config --help",
        ),
        (["schema", "a", "b"], "`mkdaemon schema` does not take 'a b'.", "mkdaemon schema --help"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(tokens, says, points_to, capsys):
    assert run(mkdaemon.app, tokens) == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    assert err.startswith("mkdaemon: ")
    assert says in err
    assert f"See `{points_to}`." in err


@pytest.mark.parametrize(
    ("tokens", "says"),
    [
        (["stick", "--pich", "8"], "Unknown option: --pich. Did you mean --pitch? See `mkctl stick --help`."),
        (["stick", "--xyzzy=8"], "Unknown option: --xyzzy. See `mkctl stick --help`."),
        (["log", "cut", "--form", "3"], "Unknown option: --form. Did you mean --from? See `mkctl log cut --help`."),
        (["goto", "-1", "2"], "`mkctl goto` needs Z. See `mkctl goto --help`."),
    ],
)
def test_a_misspelt_option_is_told_before_what_is_missing(tokens, says, capsys):
    assert run(mkctl.app, tokens) == 2
    assert capsys.readouterr().err == f"mkctl: {says}\n"


ASCII = """
import sys
from mkdaemon.cli import program
from mksim.config import PilotPlan
from mkdaemon.errors import ConfigError

def tell(word: str) -> None:
    print("3°, 2×2, ± 1 …", "\\U0001f681", flush=True)
    raise ConfigError(f"{word} ≠ °")

sys.argv = ["x", "tell", "ü"]
sys.modules["telling"] = sys.modules["__main__"]
sys.modules["__main__"].__spec__ = __import__("importlib.machinery").machinery.ModuleSpec("telling", None)
program.main("x", "", [program.CommandEntry("tell", "telling:tell", "Say.")])
"""
PLAIN_TERMINAL = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}


def test_a_terminal_without_a_letter_gets_another_one(tmp_path):
    script = tmp_path / "x.py"
    script.write_text(ASCII)
    ended = subprocess.run([sys.executable, script], capture_output=True, env=os.environ | PLAIN_TERMINAL, check=False)
    assert ended.stdout.decode("ascii") == "3 deg, 2x2, +/- 1 ... ?\n"
    assert ended.stderr.decode("ascii") == "x: ? ?  deg\n"
    assert ended.returncode == 2


@pytest.mark.parametrize("word", ["help", "version"])
def test_a_word_that_is_an_option_is_no_other_command(word, capsys):
    assert run(mkctl.app, [word]) == 2
    assert capsys.readouterr().err == f'mkctl: Unknown command "{word}". Did you mean `mkctl --{word}`?\n'


LEAVING = """
import asyncio, sys
from mkdaemon.cli import program

async def linger() -> None:
    try:
        print("here", flush=True)
        await asyncio.sleep(600)
    finally:
        print("left in order", flush=True)

sys.argv = ["x", "linger"]
sys.modules["lingering"] = sys.modules["__main__"]
sys.modules["__main__"].__spec__ = __import__("importlib.machinery").machinery.ModuleSpec("lingering", None)
program.main("x", "", [program.CommandEntry("linger", "lingering:linger", "Stay.")])
"""


@pytest.mark.parametrize(
    ("before", "signals", "ended_by"),
    [([], [signal.SIGHUP], signal.SIGHUP), (["nohup"], [signal.SIGHUP, signal.SIGTERM], signal.SIGTERM)],
)
def test_a_closed_terminal_ends_a_command_in_order_like_an_interrupt_unless_no_hangup_is_wanted(
    before, signals, ended_by
):
    """Otherwise a motor test would leave out its stop, and a backup the set that was live."""
    with subprocess.Popen([*before, sys.executable, "-c", LEAVING], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "here\n"
        for number in signals:
            process.send_signal(number)
        assert process.stdout.read() == "left in order\n"
    assert process.returncode == 128 + ended_by
