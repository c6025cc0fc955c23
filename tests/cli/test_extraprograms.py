"""Commands that come with an extra: found by entry points; where one is missing, what to install."""

from __future__ import annotations

import tomllib

import pytest

from mkdaemon.cli.mkdaemon import extraprograms
from mkdaemon.cli.mkdaemon.commands import COMMANDS
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


@pytest.mark.parametrize("name", extraprograms.EXTRAS)
def test_an_installed_command_is_the_function_that_its_entry_point_names(name):
    module, _, function = PROJECT["entry-points"][extraprograms.GROUP][name].partition(":")
    assert (getattr(extraprograms, name).__module__, getattr(extraprograms, name).__name__) == (module, function)


@pytest.mark.parametrize("words", NOT_INSTALLED)
def test_a_command_that_is_not_installed_says_in_one_line_what_to_install(words, ended):
    fix = f"`mkdaemon {words[0]}` is not installed here: pip install 'mkdaemon[sim]'"
    assert ended[words] == (2, "", f"mkdaemon: {fix}\n")


@pytest.mark.parametrize("words", OTHERS)
def test_everything_else_runs_without_the_simulator(words, ended):
    assert (ended[words].code, ended[words].err) == (0, "")
    assert ended[words].out


def test_the_doctor_needs_no_simulator(ended):
    assert "mksim" not in ended["doctor"].out + ended["doctor"].err
    assert "/dev/no-such-port" in ended["doctor"].out


def test_no_entry_point_at_all_is_the_same_as_no_package(monkeypatch, capsys):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: ())
    assert run(build("mkdaemon", "", COMMANDS), ["sim"]) == 2  # one of its own: who ran a command has imported it
    assert "pip install 'mkdaemon[sim]'" in capsys.readouterr().err


def test_other_names_are_no_commands():
    with pytest.raises(AttributeError, match="no_such"):
        _ = extraprograms.no_such
