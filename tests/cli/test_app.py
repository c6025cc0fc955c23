"""Options before the command, lists and helps, old names of commands, and completion by Tab as bash does it."""

from __future__ import annotations

import importlib
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkctl.app import move_behind_command
from mkdaemon.cli.mkctl.commands import ABOUT, COMMANDS
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import COMPLETION, EXIT_CONFIG, build, run
from mkdaemon.cli.renamed import RENAMED, new_name

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


def type_mkctl(*arguments):
    command = [sys.executable, "-m", "mkdaemon.cli.mkctl.app", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_mkctl_takes_the_vehicle_before_the_command():
    done = type_mkctl("--vehicle", "Mk 1", "lease", "show")
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


@pytest.mark.parametrize("words", [["status"], [], ["get", "record"], ["log", "list"], ["log", "record"]])
def test_a_name_that_is_kept_and_an_argument_that_looks_like_an_old_name_are_left_alone(words):
    assert new_name("mkctl", words) is None


ASK = """
source {script}
COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_mkctl
echo "${{COMPREPLY[@]}}"
"""


def program(commands=COMMANDS):
    return build("mkctl", ABOUT, commands, chosen=COMPLETION)


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    path = tmp_path_factory.mktemp("completion") / "mkctl.bash"
    assert run(program(), [COMPLETION, "--shell", "bash", "--output", str(path)]) == 0
    return path


def completed(script, words):
    shell = shutil.which("bash")
    assert shell is not None, "install bash"
    found = subprocess.run([shell, "-c", ASK.format(script=script, words=words)], capture_output=True, text=True)
    return found.stdout.split()


@pytest.mark.parametrize(
    ("words", "among"),
    [
        ("mkctl ta", {"take-off"}),
        ("mkctl lease ''", {"take", "show"}),
        ("mkctl take-off --ve", {"--vehicle"}),
    ],
)
def test_bash_completes_commands_their_second_words_and_options(script, words, among):
    assert among <= set(completed(script, words))


def test_the_startup_file_is_changed_where_no_other_file_was_asked_for(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert run(program(COMMANDS[:1]), [COMPLETION, "--shell", "bash"]) == 0
    script = tmp_path / ".local" / "share" / "bash-completion" / "completions" / "mkctl"
    assert script.is_file()
    assert str(script) in (tmp_path / ".bashrc").read_text()
    assert "mkctl completes commands" in capsys.readouterr().out


def test_a_file_that_cannot_be_written_is_named(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert run(program(COMMANDS[:1]), [COMPLETION, "--shell", "bash", "--output", str(tmp_path / "file" / "x")]) == 1
    assert "give another file by --output" in capsys.readouterr().err


def test_a_shell_that_is_not_known_is_asked_for(monkeypatch, capsys):
    monkeypatch.setattr("cyclopts.completion.detect.detect_shell", _fail)
    monkeypatch.setattr("cyclopts.core.detect_shell", _fail, raising=False)
    monkeypatch.setattr("cyclopts.completion.install.detect_shell", _fail, raising=False)
    code = run(program(COMMANDS[:1]), [COMPLETION])
    assert (code, "give --shell" in capsys.readouterr().err) == (2, True)


def _fail():
    from cyclopts.completion.detect import ShellDetectionError

    raise ShellDetectionError
