"""What installs and starts a daemon: the samples under configs/, and the recipe of the image."""

from __future__ import annotations

import configparser
import fnmatch
import json
import re
import shlex
import shutil
import subprocess
import tomllib

import pytest

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkctl.record import record
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from tests.places import CONFIGS, ROOT

UNIT = CONFIGS / "systemd" / "mkdaemon.service"
RECORDER = CONFIGS / "systemd" / "mkdaemon-recorder.service"


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


def test_the_unit_exposes_little(installed):
    said = systemd_analyze("security", "--offline=true", str(installed))
    exposure = re.search(r"exposure level .*: ([0-9.]+)", said.stdout)
    assert exposure is not None, said.stdout + said.stderr
    assert float(exposure[1]) <= 2.0


RECIPE = (ROOT / "Containerfile").read_text(encoding="utf-8")
FIRST = ROOT / "programs" / "first-process"
PROGRAMS = {"mkctl": mkctl, "mkdaemon": mkdaemon}


def instructions():
    """Every instruction with its words, the long ones in one line."""
    lines = re.sub(r"\\\n\s*", "", RECIPE).splitlines()
    return [tuple(line.split(maxsplit=1)) for line in lines if line.strip() and not line.startswith("#")]


def words_of(name):
    return [words for each, words in instructions() if each == name]


def test_everything_that_is_copied_exists():
    copied = [shlex.split(words) for words in words_of("COPY")]
    sources = [source for words in copied if not words[0].startswith("--") for source in words[:-1]]
    assert len(sources) > 5
    assert [source for source in sources if not (ROOT / source).exists()] == []


def test_the_build_has_all_that_the_wheel_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {*wheel["packages"], *wheel["shared-scripts"], *wheel["shared-data"], project["project"]["readme"]}
    needed |= {"pyproject.toml", *project["project"]["license-files"]}
    copied = {word for words in words_of("COPY") for word in shlex.split(words)}
    assert {path.split("/")[0] for path in needed} <= copied


def test_what_only_builds_is_taken_out_and_nothing_else():
    pinned = re.findall(r"^([a-z-]+)==", (ROOT / "requirements-aircraft.txt").read_text(encoding="utf-8"), re.MULTILINE)
    (removed,) = re.findall(r"uninstall --yes --quiet ([a-z -]+)$", "\n".join(words_of("RUN")), re.MULTILINE)
    builds = {"hatch-vcs", "hatchling", "pathspec", "pluggy", "setuptools", "setuptools-scm", "trove-classifiers"}
    builds |= {"vcs-versioning"}
    assert set(removed.split()) == {*builds, "pip"}
    assert builds <= set(pinned)


def test_it_runs_as_a_user_without_rights_who_may_open_lines_and_cameras():
    assert words_of("USER") == ["mkdaemon"]
    (made,) = [words for words in words_of("RUN") if "useradd" in words]
    assert re.search(r"--uid [1-9]\d* --groups dialout,video .* mkdaemon ", made)
    after = [name for name, _ in instructions()]
    assert "RUN" not in after[after.index("USER") :]


def test_every_command_of_the_image_exists():
    (start,), (given,), (health,) = (words_of(name) for name in ("ENTRYPOINT", "CMD", "HEALTHCHECK"))
    first, *program = json.loads(start)
    assert first == FIRST.name
    for name, *words in (program + json.loads(given), json.loads(health.partition("CMD ")[2])):
        PROGRAMS[name].parse_args(words, exit_on_error=False, print_error=False)


@pytest.mark.parametrize("code", [0, 7])
def test_the_first_process_waits_for_the_guard_and_ends_as_the_daemon_did(code, tmp_path):
    guard = tmp_path / "77" / "cmdline"
    guard.parent.mkdir()
    guard.write_bytes(b"python\0-I\0guard.py\0")
    daemon = f"(sleep 0.4; rm {guard}; echo released) & exit {code}"
    done = subprocess.run(
        ["sh", FIRST, "sh", "-c", daemon], env={"PATH": "/usr/bin:/bin", "PROC": str(tmp_path)}, capture_output=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, b"released\n", b"")


def test_the_first_process_hands_sigterm_on_and_ends_as_the_daemon_does(tmp_path):
    daemon = "trap 'echo in order; exit 3' TERM; echo ready; while :; do sleep 0.05; done"
    process = subprocess.Popen(
        ["sh", FIRST, "sh", "-c", daemon],
        env={"PATH": "/usr/bin:/bin", "PROC": str(tmp_path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    process.terminate()
    assert process.communicate() == ("in order\n", None)
    assert process.returncode == 3
