"""Commands that come with an extra: found by entry points; where one is missing, what to install."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import pytest

from mkdaemon.cli.mkdaemon import extraprograms
from mkdaemon.cli.mkdaemon.app import COMMANDS, app
from mkdaemon.cli.program import run
from tests.places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WITHOUT_SIMULATOR = """
import sys
sys.modules["mksim"] = None  # as if it were not installed
from mkdaemon.cli.mkdaemon.app import main
main()
"""


def run_without_simulator(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WITHOUT_SIMULATOR, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def test_the_project_offers_every_command_under_an_extra_that_exists():
    assert PROJECT["entry-points"][extraprograms.GROUP].keys() == extraprograms.EXTRAS.keys()
    assert set(extraprograms.EXTRAS.values()) <= PROJECT["optional-dependencies"].keys()
    named = {entry.name for entry in COMMANDS if entry.target.startswith(f"{extraprograms.__name__}:")}
    assert named == extraprograms.EXTRAS.keys()


@pytest.mark.parametrize("name", extraprograms.EXTRAS)
def test_an_installed_command_is_the_function_that_its_entry_point_names(name):
    module, _, function = PROJECT["entry-points"][extraprograms.GROUP][name].partition(":")
    assert (getattr(extraprograms, name).__module__, getattr(extraprograms, name).__name__) == (module, function)


@pytest.mark.parametrize("words", [("sim",), ("sim", "--board", "fc"), ("demo", "--fast"), ("demo", "--help")])
def test_a_command_that_is_not_installed_says_in_one_line_what_to_install(words):
    done = run_without_simulator(*words)
    fix = f"`mkdaemon {words[0]}` is not installed here: pip install 'mkdaemon[sim]'"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"mkdaemon: {fix}\n")


@pytest.mark.parametrize("words", [("--help",), ("doctor", "--help"), ("run", "--help"), ("schema",)])
def test_everything_else_runs_without_the_simulator(words):
    done = run_without_simulator(*words)
    assert (done.returncode, done.stderr) == (0, "")


def test_daemon_doctor_and_clients_need_no_simulator(tmp_path):
    config = tmp_path / "aircraft.toml"
    config.write_text('[link]\nport = "/dev/no-such-port"\n[sim]\nboard = "only the simulator reads this"\n')
    done = run_without_simulator("doctor", "--config", str(config), "--json")
    assert "mksim" not in done.stdout + done.stderr
    assert "/dev/no-such-port" in done.stdout
    parts = "import mkdaemon.daemon.program, mkdaemon.cli.mkctl.app, mkdaemon.client, mkdaemon.replay"
    script = f'import sys\nsys.modules["mksim"] = None\n{parts}'
    assert subprocess.run([sys.executable, "-c", script], timeout=120).returncode == 0


def test_no_entry_point_at_all_is_the_same_as_no_package(monkeypatch, capsys):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: ())
    assert run(app, ["sim"]) == 2
    assert "pip install 'mkdaemon[sim]'" in capsys.readouterr().err


def test_other_names_are_no_commands():
    with pytest.raises(AttributeError, match="no_such"):
        _ = extraprograms.no_such
