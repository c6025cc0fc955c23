"""Installations without an extra: commands are found by entry points, and what needs one says what to install."""

from __future__ import annotations

import sys
import tomllib

import pytest

from mkdaemon.cli.mkdaemon import extraprograms
from mkdaemon.cli.mkdaemon.commands import COMMANDS
from mkdaemon.cli.mkdaemon.doctor.check import Severity
from mkdaemon.cli.mkdaemon.doctor.machine import Machine
from mkdaemon.cli.mkdaemon.doctor.table import examine
from mkdaemon.cli.program import build, run
from tests.cli.oneprocess import run_commands
from tests.places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NOT_INSTALLED = (("sim",), ("sim", "--board", "fc"), ("demo", "--fast"), ("demo", "--help"))
OTHERS = (("--help",), ("doctor", "--help"), ("run", "--help"), ("schema",))


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """What commands come to in a process that finds no simulator, by their words; the doctor has a configuration."""
    config = tmp_path_factory.mktemp("aircraft") / "aircraft.toml"
    config.write_text('[link]\nport = "/dev/no-such-port"\n[sim]\nboard = "only the simulator reads this"\n')
    commands = (*NOT_INSTALLED, *OTHERS, ("doctor", "--config", str(config), "--json"))
    imported = ["mkdaemon.daemon.program", "mkdaemon.cli.mkctl.app", "mkdaemon.client", "mkdaemon.replay"]
    answers = run_commands(commands, missing=["mksim"], imported=imported)
    return dict(zip((*commands[:-1], "doctor"), answers, strict=True))


def test_the_project_offers_every_command_under_an_extra_that_exists():
    assert PROJECT["entry-points"][extraprograms.GROUP].keys() == extraprograms.EXTRAS.keys()
    assert set(extraprograms.EXTRAS.values()) <= PROJECT["optional-dependencies"].keys()
    named = {entry.name for entry in COMMANDS if entry.target.startswith(f"{extraprograms.__name__}:")}
    assert named == extraprograms.EXTRAS.keys()


@pytest.mark.parametrize("words", NOT_INSTALLED)
def test_a_command_that_is_not_installed_says_in_one_line_what_to_install(words, ended):
    fix = f"`mkdaemon {words[0]}` is not installed here: pip install 'mkdaemon[sim]'"
    assert ended[words] == (2, "", f"mkdaemon: {fix}\n")


@pytest.mark.parametrize("words", OTHERS)
def test_everything_else_runs_without_the_simulator(words, ended):
    assert (ended[words].code, ended[words].err) == (0, "")
    assert ended[words].out


def test_no_entry_point_at_all_is_the_same_as_no_package(monkeypatch, capsys):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: ())
    assert run(build("mkdaemon", "", COMMANDS), ["sim"]) == 2  # one of its own: who ran a command has imported it
    assert "pip install 'mkdaemon[sim]'" in capsys.readouterr().err


FIX = "cameras and tags need OpenCV, which is not installed: pip install 'mkdaemon[vision]'"
SIMULATOR_FIX = "the simulated camera needs OpenCV, which is not installed: pip install 'mkdaemon[sim]'"
MISSING = ("cv2", "pyapriltags")
OF_CAMERAS = (
    ("detect", "picture.png"),
    ("calibrate", "print", "x.svg", "--tag", "7:0.16"),
    ("calibrate", "camera", "pictures", "-o", "camera.toml"),
)
OF_SIMULATED_CAMERA = ("demo", "--fast")


@pytest.fixture(scope="module")
def ended_without():
    """What commands come to in a process that finds no OpenCV, by their words; the daemon can be imported there."""
    imported = ["mkdaemon.daemon", "mkdaemon.client", "mksim.simulation", "mksim.runtime", "mkdaemon.cli.mkctl.app"]
    together = (*OF_CAMERAS, OF_SIMULATED_CAMERA)
    answers = run_commands(together, missing=MISSING, imported=[*imported, "mkdaemon.missions"])
    return dict(zip(together, answers, strict=True))


@pytest.mark.parametrize("words", OF_CAMERAS, ids=lambda words: words[0])
def test_a_program_of_the_camera_side_names_the_extra_in_one_line(words, ended_without):
    assert ended_without[words] == (2, "", f"mkdaemon: {FIX}\n")


def test_a_program_with_the_simulated_camera_names_the_extra_of_the_simulator(ended_without):
    assert ended_without[OF_SIMULATED_CAMERA] == (2, "", f"mkdaemon: {SIMULATOR_FIX}\n")


def test_the_doctor_finds_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    machine = Machine(tmp_path)
    config = tmp_path / "camera.toml"
    config.write_text('[[cameras]]\nsource = "/dev/video0"\n', encoding="utf-8")
    monkeypatch.delitem(sys.modules, "mkdaemon.vision.worker", raising=False)
    monkeypatch.delitem(sys.modules, "mkdaemon.vision", raising=False)
    found = [finding for finding in examine(machine, config).findings if finding.check == "configuration"]
    assert (found[0].severity, found[0].what) == (Severity.ERROR, FIX)
