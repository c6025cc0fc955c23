"""The samples under configs/: what systemd, udev and a shell say about them."""

from __future__ import annotations

import configparser
import fnmatch
import re
import shutil
import subprocess

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkctl.record import record
from tests.places import CONFIGS, ROOT

UNIT = CONFIGS / "systemd" / "mkdaemon.service"
RECORDER = CONFIGS / "systemd" / "mkdaemon-recorder.service"
RULES = CONFIGS / "udev" / "60-mkdaemon.rules"


def systemd_analyze(*arguments):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze here: what systemd thinks of the unit cannot be asked")
    return subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, check=False)


@pytest.fixture(params=sorted((CONFIGS / "systemd").iterdir()), ids=lambda unit: unit.stem)
def installed(request, tmp_path):
    """The unit as systemd would load it, a template as one of its instances, with a program of this machine."""
    unit = tmp_path / request.param.name.replace("@.", "@mavlink.")
    unit.write_text(re.sub(r"(?m)^ExecStart=\S+", "ExecStart=/bin/true", request.param.read_text(encoding="utf-8")))
    return unit


def test_systemd_accepts_every_line_of_the_unit(installed):
    said = systemd_analyze("verify", "--man=no", str(installed))
    assert (said.returncode, said.stderr) == (0, "")


def test_the_recorder_is_started_with_options_that_exist():
    line = re.search(r"(?m)^ExecStart=\S+ (.+)$", RECORDER.read_text(encoding="utf-8"))
    words = line[1].removesuffix(" $OPTIONS").split()
    function, bound, _ = mkctl.parse_args(words, exit_on_error=False, print_error=False)
    assert function is record
    assert str(bound.kwargs["folder"]) == "/var/lib/mkdaemon-recorder"


def test_a_daemon_that_keeps_failing_is_started_again_for_ever():
    """systemd gives a unit up after five starts in ten seconds unless it is told not to: in flight that is the end."""
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str
    unit.read(UNIT, encoding="utf-8")
    assert unit["Unit"]["StartLimitIntervalSec"] == "0"
    assert (unit["Service"]["Restart"], unit["Service"]["Type"]) == ("on-failure", "notify")


@pytest.mark.parametrize(
    ("driver", "is_open"),
    [
        *((name, True) for name in ("ttyUSB", "ttyACM", "ttyAMA", "ttyS", "ttyTHS", "video4linux")),
        *((name, False) for name in ("mem", "tty", "kvm", "input", "gpiochip", "vcs", "ttyprintk")),
    ],
)
def test_the_unit_opens_serial_lines_and_cameras_alone(driver, is_open):
    """By the names of drivers in /proc/devices, as systemd matches them."""
    lines = UNIT.read_text(encoding="utf-8").splitlines()
    assert "DevicePolicy=closed" in lines
    allowed = [line.removeprefix("DeviceAllow=char-").split()[0] for line in lines if line.startswith("DeviceAllow=")]
    assert any(fnmatch.fnmatchcase(driver, pattern) for pattern in allowed) is is_open


def test_the_recipe_of_the_service_installs_what_flies_and_no_tools_of_development():
    recipe = (ROOT / "docs" / "operations.md").read_text(encoding="utf-8").partition("## As a service")[2]
    assert "make -C /opt/mkdaemon-$V install" in recipe.partition("```")[2]
    commands = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ninstall:")[2].partition("\n\n")[0]
    assert "--require-hashes" in commands
    assert "dev" not in commands


def test_the_unit_exposes_little(installed):
    said = systemd_analyze("security", "--offline=true", str(installed))
    exposure = re.search(r"exposure level .*: ([0-9.]+)", said.stdout)
    assert exposure is not None, said.stdout + said.stderr
    assert float(exposure[1]) <= 2.0


def test_udev_rules_are_matches_and_assignments():
    rules = [line for line in RULES.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    assert rules
    term = r'[A-Z]+(\{\w+\})?(==|=|\+=)"[^"]*"'
    for rule in rules:
        assert re.fullmatch(rf"{term}(, {term})*", rule), rule
