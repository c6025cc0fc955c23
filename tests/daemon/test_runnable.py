"""One check says what stands in the way of a configuration: `run` refuses by it, and `doctor` prints it."""

from __future__ import annotations

import asyncio
import io

import pytest
from rich.console import Console

from mkdaemon.cli.mkdaemon.doctor.check import Severity
from mkdaemon.cli.mkdaemon.doctor.command import show
from mkdaemon.cli.mkdaemon.doctor.machine import Machine
from mkdaemon.cli.mkdaemon.doctor.table import examine
from mkdaemon.config.reader import load
from mkdaemon.daemon.program import run
from mkdaemon.errors import ConfigError
from tests.places import CONFIGS

TARGET = str(CONFIGS / "targets" / "nested.toml")
CAMERA = f'[[cameras]]\nsource = "/dev/video9"\ntargets = ["{TARGET}"]\n'
PORT = '[link]\nport = "/dev/ttyUSB0"\n'
WRONG = {
    "two cameras of one name": (PORT + CAMERA + CAMERA, "two cameras are called 'down'"),
    "a target file as calibration": (PORT + CAMERA + f'calibration = "{TARGET}"\n', "camera file"),
    "a calibration that is not there": (PORT + CAMERA + 'calibration = "none.toml"\n', "calibrate camera"),
    "a camera without targets": (PORT + '[[cameras]]\nsource = "/dev/video9"\n', "no targets"),
    "a source that is none": (PORT + CAMERA.replace("/dev/video9", "the front one"), "'the front one' is none of"),
    "a stream nobody sends": (PORT + "rates = { osf = 100 }\n", "there is no stream 'osf'"),
    "more than the line carries": (PORT + "rates = { osd = 20, debug = 70 }\n", "% of the line"),
    "a port without its folder": ('[link]\nport = "ttyUSB0"\n', "/dev/ttyUSB0"),
    "a port of no kind": ('[link]\nport = "udp:10.0.0.1:7"\n', "is not a port"),
    "a loop that is not safe": (PORT + "[control.limiter]\nslew = 50\n" + CAMERA, "control.limiter.slew"),
    "a bus open to everybody": (
        PORT + '[bus]\nlisten = ["tcp/0.0.0.0:7447"]\n',
        "every program in the network could",
    ),
    "an endpoint that is none": (PORT + '[bus]\nlisten = ["7447"]\n', "is not a Zenoh endpoint"),
    "a group that nobody is in": (PORT + '[bus]\nlocal_group = "no-such-group"\n', "no group 'no-such-group'"),
}


@pytest.fixture
def machine(tmp_path):
    (tmp_path / "root").mkdir()
    return Machine(tmp_path / "root")


@pytest.mark.parametrize(("text", "words"), WRONG.values(), ids=WRONG)
async def test_what_run_refuses_the_doctor_calls_bad_in_the_same_words(text, words, tmp_path, machine):
    path = tmp_path / "aircraft.toml"
    path.write_text(text, encoding="utf-8")
    try:
        cfg = load(path)
    except ConfigError as error:
        refusal = str(error)
    else:
        with pytest.raises(ConfigError) as refused:
            await run(cfg, asyncio.Event())
        refusal = str(refused.value)
    assert words in refusal
    found = [finding for finding in examine(machine, path).findings if finding.check == "configuration"]
    assert (found[0].severity, found[0].what) == (Severity.ERROR, refusal)


def test_the_doctor_names_every_mistake(tmp_path, machine):
    path = tmp_path / "aircraft.toml"
    path.write_text('[link]\nport = "ttyUSB0"\nrates = { osf = 100 }\n', encoding="utf-8")
    found = [finding for finding in examine(machine, path).findings if finding.check == "configuration"]
    assert [finding.severity for finding in found] == [Severity.ERROR, Severity.ERROR]


@pytest.mark.parametrize("name", ["cyberquad.toml", "sim.toml", "sim-vision.toml"])
def test_the_samples_are_valid(name, machine, monkeypatch):
    monkeypatch.chdir(CONFIGS.parent)
    seen = examine(machine, CONFIGS / name)
    assert "configuration" not in {finding.check for finding in seen.findings}


def test_brackets_of_a_finding_are_shown_as_they_are(tmp_path, machine):
    path = tmp_path / "aircraft.toml"
    path.write_text("[link]\nport = 7\n[[cameras]]\n[cameras.mount]\nlooks = '[red]'\n", encoding="utf-8")
    console = Console(width=400, record=True, file=io.StringIO())
    seen = examine(machine, path)
    said = tuple(finding._replace(what="[link] [red]no[/red] [nothing") for finding in seen.findings)
    show(seen._replace(findings=said), console)
    assert "[link] [red]no[/red] [nothing" in console.export_text()
