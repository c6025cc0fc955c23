"""Options of every command before the command."""

from __future__ import annotations

import subprocess
import sys

import pytest

from mkdaemon.cli.mkctl.app import move_behind_command

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
    assert (code, modules < 12) == (2, True)
    assert done.stderr == 'mkctl: Unknown command "statsu". Did you mean "status"? See `mkctl --help`.\n'


def test_help_imports_nothing_that_only_a_command_needs():
    code = (
        "import sys; from mkdaemon.cli.mkctl.app import app; from mkdaemon.cli.program import run\n"
        "run(app, ['--help'])\n"
        "print(*({'zenoh', 'pydantic', 'numpy', 'msgpack', 'importlib.metadata'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "\n"
