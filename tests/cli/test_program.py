"""Command tables, errors and exit codes of both programs."""

from __future__ import annotations

import importlib
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from cyclopts import App

from lab.__main__ import CAMPAIGNS
from mkdaemon.cli.listing import CommandEntry
from mkdaemon.cli.mkctl import app as mkctl
from mkdaemon.cli.mkdaemon import app as mkdaemon
from mkdaemon.cli.program import build, run
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError
from mksim.config import PilotPlan
from tests.places import SOURCE

MKDAEMON = [sys.executable, "-c", "from mkdaemon.cli.entry import mkdaemon; mkdaemon()"]
TABLES = [*mkctl.COMMANDS, *mkdaemon.COMMANDS, *CAMPAIGNS]


def piped(*arguments):
    pipe = subprocess.PIPE
    return subprocess.Popen([*MKDAEMON, *arguments], stdin=pipe, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize("entry", TABLES, ids=lambda entry: entry.target)
def test_every_command_of_the_tables_exists(entry):
    module, _, name = entry.target.partition(":")
    target = getattr(importlib.import_module(module), name)
    assert callable(target)
    if isinstance(target, App):
        assert target.name[0] == entry.name
    assert entry.help.endswith(".")


HELP = json.loads((SOURCE / "cli" / "help.json").read_text(encoding="utf-8"))
"""What `tools.docs` writes, and the programs print."""


@pytest.mark.parametrize("program", [mkctl, mkdaemon], ids=["mkctl", "mkdaemon"])
def test_every_command_has_a_help(program):
    name = program.__name__.split(".")[-2]
    assert {f"{name} {entry.name}" for entry in program.COMMANDS if entry.is_shown} <= HELP.keys()


@pytest.mark.parametrize("command", HELP)
def test_a_help_has_no_clutter(command):
    out = HELP[command]
    assert out.startswith(f"Usage: {command}")
    assert not re.search(r"--([\w-]+) --no-\1", out), "an option and its opposite"
    assert "Raises" not in out, "Google and numpy sections mixed in one docstring"
    assert not re.search(r"│ [A-Z]+ +│", out), "an argument without a word about it"


def test_a_group_that_is_asked_of_cyclopts_shows_the_first_line_of_each_command(capsys):
    assert run(mkctl.app, ["log", "--help"]) == 0
    assert "Write a recording for other programs." in capsys.readouterr().out


def test_the_help_of_the_simulator_names_every_plan_of_its_pilot_and_the_key_of_poses():
    out = HELP["mkdaemon sim"]
    assert set(PilotPlan) <= set(re.split(r"[\s,.:;│]+", out))
    assert "mk/NAME/sim/pose" in out


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


def test_the_daemon_lets_numpy_start_no_threads(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setattr(mkdaemon, "_main", lambda *_: None)
    mkdaemon.main()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


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
PLAIN_TERMINALS = [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}]


@pytest.mark.parametrize("environment", PLAIN_TERMINALS, ids=["PYTHONIOENCODING", "LC_ALL"])
def test_a_terminal_without_a_letter_gets_another_one(environment, tmp_path):
    script = tmp_path / "x.py"
    script.write_text(ASCII)
    ended = subprocess.run([sys.executable, script], capture_output=True, env=os.environ | environment, check=False)
    assert ended.stdout.decode("ascii") == "3 deg, 2x2, +/- 1 ... ?\n"
    assert ended.stderr.decode("ascii") == "x: ? ?  deg\n"
    assert ended.returncode == 2


def test_an_argument_that_is_no_text_is_one_line(capsys):
    app = App(name="x")

    @app.default
    def send(word: str) -> None:
        word.encode()

    assert run(app, ["\udcc3"]) == 2
    assert capsys.readouterr().err == "x: '\\udcc3' is not text in this encoding: set LC_ALL=C.UTF-8\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_while_a_mistake_is_told_shows_no_traceback(number):
    code = (
        f"import os, sys; from mkdaemon.cli import program; from mkdaemon.errors import MkError\n"
        f"class Slow(MkError):\n"
        f"    def __str__(self): os.kill(os.getpid(), {int(number)}); return 'slow'\n"
        f"def fail(): raise Slow('slow')\n"
        f"sys.modules['failing'] = sys.modules['__main__']\n"
        f"sys.modules['__main__'].__spec__ = __import__('importlib.machinery').machinery.ModuleSpec('failing', None)\n"
        f"program.main('x', '', [program.CommandEntry('fail', 'failing:fail', 'Fail.')], ['fail'])"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (128 + number, "")


@pytest.mark.parametrize("word", ["help", "version"])
def test_a_word_that_is_an_option_is_no_other_command(word, capsys):
    assert run(mkctl.app, [word]) == 2
    assert capsys.readouterr().err == f'mkctl: Unknown command "{word}". Did you mean `mkctl --{word}`?\n'


def test_a_full_disk_is_one_line():
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run([*MKDAEMON, "schema", "--wire"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 1
    assert ended.stderr == "mkdaemon: standard output: No space left on device\n"


def test_a_reader_that_has_seen_enough_is_no_error():
    with piped("schema", "--wire") as program:
        assert program.stdout.readline() == "[\n"
        program.stdout.close()
        assert (program.stderr.read(), program.wait()) == ("", 0)


def test_an_interrupt_while_importing_is_silent():
    # The import of the program is what takes long; here it never ends.
    code = (
        "import os, signal, sys, types, mkdaemon.cli.entry as entry\n"
        "class Slow(types.ModuleType):\n"
        "    def __getattr__(self, name): os.kill(os.getpid(), signal.SIGINT); raise AssertionError('still here')\n"
        "sys.modules['mkdaemon.cli.mkdaemon.app'] = Slow('slow')\n"
        "sys.argv = ['mkdaemon', 'run']\n"
        "entry.mkdaemon()"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (-signal.SIGINT, "")


SWALLOWED = """
import os, signal, sys
import mkdaemon.cli.entry
from mkdaemon.cli import program

class Importer:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            try:
                os.kill(os.getpid(), signal.SIGINT)
            except KeyboardInterrupt:
                pass  # as a callback of the import machinery does
            print("still here", flush=True)

sys.meta_path.insert(0, Importer())
sys.argv = ["mkdaemon", *{arguments!r}]
mkdaemon.cli.entry.mkdaemon()
"""


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("mkdaemon.config.reader", ["run", "--port", "none"]),  # imported with the command
        ("uvloop", ["run", "--port", "none"]),  # imported by the command, before its own handlers stand
    ],
)
def test_an_interrupt_while_the_command_is_imported_is_not_lost(module, arguments):
    code = SWALLOWED.format(module=module, arguments=arguments)
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=30)
    assert (ended.returncode, ended.stdout, ended.stderr) == (-signal.SIGINT, "", "")


def test_a_command_is_imported_without_the_collector(tmp_path):
    (tmp_path / "looked.py").write_text("import gc\nseen = gc.isenabled()\n", encoding="utf-8")
    code = (
        "import gc, sys\n"
        "from mkdaemon.cli.listing import CommandEntry\nfrom mkdaemon.cli.program import main\n"
        "import atexit; atexit.register(lambda: print(sys.modules['looked'].seen, gc.isenabled()))\n"
        "main('x', 'x', [CommandEntry('look', 'looked:seen', 'x')], ['look'])"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    assert ended.stdout.splitlines()[-1:] == ["False True"]


def test_an_interrupt_after_importing_ends_in_order():
    with piped("decode", "-") as program:
        program.stdin.write("#av@w\r")
        program.stdin.flush()
        assert "VersionRequest" in program.stdout.readline()
        program.send_signal(signal.SIGINT)
        assert (program.stderr.read(), program.wait()) == ("", 130)


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
