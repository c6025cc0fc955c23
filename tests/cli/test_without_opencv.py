"""An installation without the extra `vision`: everything but cameras works, and what needs one says what to install."""

from __future__ import annotations

import subprocess
import sys

import pytest

from mkdaemon.cli.mkdaemon.doctor import Machine, Verdict, examine
from tests.bus.support import free_endpoint
from tests.places import CONFIGS

MISSING = """
import sys
sys.modules |= dict.fromkeys(["cv2", "pyapriltags"])  # None: as if they were not installed
"""
FIX = "cameras and tags need OpenCV, which is not installed: pip install 'mkdaemon[vision]'"
SIMULATOR_FIX = "the simulated camera needs OpenCV, which is not installed: pip install 'mkdaemon[sim]'"


def run_without_opencv(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", MISSING + code], capture_output=True, text=True, timeout=120)


def run_program(*words: str) -> subprocess.CompletedProcess[str]:
    imports = "from mkdaemon.cli.mkdaemon.app import app\nfrom mkdaemon.cli.program import run\n"
    return run_without_opencv(f"{imports}sys.exit(run(app, {words!r}))")


def test_daemon_simulator_and_client_need_no_opencv():
    done = run_without_opencv(
        "import mkdaemon.daemon, mkdaemon.client, mksim.simulation, mksim.runtime\n"
        "import mkdaemon.cli.mkdaemon.app, mkdaemon.cli.mkctl.app, mkdaemon.missions"
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_configured_camera_is_a_configuration_error_that_names_the_extra(tmp_path):
    config = tmp_path / "camera.toml"
    link = '[link]\nport = "tcp:localhost:9"\nwait_for_port = true\n'
    config.write_text(link + '[[cameras]]\nsource = "/dev/video0"\n', encoding="utf-8")
    done = run_program("run", "--config", str(config), "--listen", free_endpoint(), "--log", "error")
    assert (done.returncode, done.stderr) == (2, f"mkdaemon: {FIX}\n")


@pytest.mark.parametrize(
    "words",
    [
        ("detect", "picture.png"),
        ("target", "x.svg", "--tag", "7:0.16"),
        ("calibrate", "camera", "pictures", "-o", "camera.toml"),
    ],
    ids=lambda words: words[0],
)
def test_a_program_of_the_camera_side_names_the_extra_in_one_line(words):
    done = run_program(*words)
    assert (done.returncode, done.stderr) == (2, f"mkdaemon: {FIX}\n")


@pytest.mark.parametrize(
    "words", [("demo", "--fast"), ("sim", "--config", str(CONFIGS / "sim-vision.toml")), ("sim", "--scene-only")]
)
def test_a_program_with_the_simulated_camera_names_the_extra_of_the_simulator(words):
    done = run_program(*words)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"mkdaemon: {SIMULATOR_FIX}\n")


def test_the_doctor_finds_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    machine = Machine(tmp_path, tmp_path, tmp_path)
    config = tmp_path / "camera.toml"
    config.write_text('[[cameras]]\nsource = "/dev/video0"\n', encoding="utf-8")
    monkeypatch.delitem(sys.modules, "mkdaemon.vision.worker", raising=False)
    monkeypatch.delitem(sys.modules, "mkdaemon.vision", raising=False)
    found = [finding for finding in examine(machine, config) if finding.what == "configuration"]
    assert (found[0].verdict, found[0].found) == (Verdict.BAD, FIX)
