"""An installation without the extra `vision`: everything but cameras works, and what needs one says what to install."""

from __future__ import annotations

import sys
from importlib import import_module

import pytest

from mkdaemon.cli.mkdaemon.doctor.check import Severity
from mkdaemon.cli.mkdaemon.doctor.machine import Machine
from mkdaemon.cli.mkdaemon.doctor.table import examine
from mkdaemon.errors import ConfigError
from tests.bus.support import free_endpoint
from tests.cli.oneprocess import run_alone, run_commands
from tests.places import CONFIGS

FIX = "cameras and tags need OpenCV, which is not installed: pip install 'mkdaemon[vision]'"
SIMULATOR_FIX = "the simulated camera needs OpenCV, which is not installed: pip install 'mkdaemon[sim]'"
MISSING = ("cv2", "pyapriltags")
OF_CAMERAS = (
    ("detect", "picture.png"),
    ("calibrate", "print", "x.svg", "--tag", "7:0.16"),
    ("calibrate", "camera", "pictures", "-o", "camera.toml"),
)
OF_SIMULATED_CAMERAS = (
    ("demo", "--fast"),
    ("sim", "--config", str(CONFIGS / "sim-vision.toml")),
    ("sim", "--scene-only"),
)


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """What commands come to in a process that finds no OpenCV, by their words; `run` has a camera configured."""
    config = tmp_path_factory.mktemp("camera") / "camera.toml"
    link = '[link]\nport = "tcp:localhost:9"\nwait_for_port = true\n'
    config.write_text(link + '[[cameras]]\nsource = "/dev/video0"\n', encoding="utf-8")
    run = ("run", "--config", str(config), "--listen", free_endpoint(), "--log", "error")
    imported = ["mkdaemon.daemon", "mkdaemon.client", "mksim.simulation", "mksim.runtime", "mkdaemon.cli.mkctl.app"]
    together = (*OF_CAMERAS, OF_SIMULATED_CAMERAS[0])
    answers = run_commands(together, missing=MISSING, imported=[*imported, "mkdaemon.missions"])
    alone = {words: run_alone(words, missing=MISSING) for words in OF_SIMULATED_CAMERAS[1:]}
    return {"run": run_alone(run, missing=MISSING)} | alone | dict(zip(together, answers, strict=True))


def test_daemon_simulator_and_client_need_no_opencv(ended):
    assert ended, "they were imported"


def test_a_configured_camera_is_a_configuration_error_that_names_the_extra(ended):
    assert ended["run"] == (2, "", f"mkdaemon: {FIX}\n")


@pytest.mark.parametrize("words", OF_CAMERAS, ids=lambda words: words[0])
def test_a_program_of_the_camera_side_names_the_extra_in_one_line(words, ended):
    assert ended[words] == (2, "", f"mkdaemon: {FIX}\n")


@pytest.mark.parametrize("words", OF_SIMULATED_CAMERAS)
def test_a_program_with_the_simulated_camera_names_the_extra_of_the_simulator(words, ended):
    assert ended[words] == (2, "", f"mkdaemon: {SIMULATOR_FIX}\n")


def test_the_doctor_finds_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    machine = Machine(tmp_path)
    config = tmp_path / "camera.toml"
    config.write_text('[[cameras]]\nsource = "/dev/video0"\n', encoding="utf-8")
    monkeypatch.delitem(sys.modules, "mkdaemon.vision.worker", raising=False)
    monkeypatch.delitem(sys.modules, "mkdaemon.vision", raising=False)
    found = [finding for finding in examine(machine, config).findings if finding.check == "configuration"]
    assert (found[0].severity, found[0].what) == (Severity.ERROR, FIX)


@pytest.mark.parametrize("missing", ["pyapriltags", "simplejpeg"])
def test_opencv_alone_sees_no_tags(missing, monkeypatch):
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.delitem(sys.modules, "mkdaemon.vision", raising=False)
    with pytest.raises(ConfigError, match=rf"need {missing}, .*pip install 'mkdaemon\[vision\]'"):
        import_module("mkdaemon.vision")
