"""`mkdaemon install-service`: what it shows, writes and removes, on a machine of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.mkdaemon.service.installing import Host, plan, preview, programs_folder, remove_units, write_units
from mkdaemon.cli.mkdaemon.service.units import MARK, UNITS, unit_text
from mkdaemon.cli.program import run
from mkdaemon.cli.systemcommands import CommandOutput
from mkdaemon.errors import ConfigError

PROGRAMS = Path("/opt/mkdaemon/.venv/bin")
FOLDER = "etc/systemd/system"


@pytest.fixture
def host(tmp_path):
    typed = []

    def answer(words):
        typed.append(" ".join(words))
        return CommandOutput(0, "")

    host = Host(tmp_path, answer)
    object.__setattr__(host, "typed", typed)
    return host


def words_of(steps):
    return [step.words for step in steps]


def units_of(host):
    return sorted(path.name for path in (host.root / FOLDER).glob("*.service"))


def test_a_preview_shows_all_and_writes_nothing(host):
    lines = list(preview(host, plan(("daemon", "recorder", "gateway"), None, "ros2"), PROGRAMS))
    assert "# /etc/systemd/system/mkdaemon.service (new)" in lines
    assert "ExecStart=/opt/mkdaemon/.venv/bin/mkdaemon run --config /etc/mkdaemon/vehicle.toml" in lines
    assert "# /etc/udev/rules.d/60-mkdaemon.rules (new)" in lines
    assert lines[-1].startswith("# nothing was written")
    assert list(host.root.iterdir()) == []
    assert host.typed == []


def test_units_are_written_shown_as_there_and_removed(host):
    chosen = plan(("daemon",), None, "")
    lines = words_of(write_units(host, chosen, PROGRAMS))
    assert lines == [
        "wrote /etc/systemd/system/mkdaemon.service",
        "wrote /etc/udev/rules.d/60-mkdaemon.rules",
        "typed udevadm control --reload",
        "typed systemctl daemon-reload",
        "next: sudo install -d /etc/mkdaemon && sudo /opt/mkdaemon/.venv/bin/mkdaemon config new "
        "/etc/mkdaemon/vehicle.toml",
        "next: sudo systemctl enable --now mkdaemon",
    ]
    unit = host.root / FOLDER / "mkdaemon.service"
    assert unit.read_text(encoding="utf-8") == unit_text(UNITS[0], PROGRAMS)
    assert unit.stat().st_mode & 0o777 == 0o644
    assert "# /etc/systemd/system/mkdaemon.service (there already)" in list(preview(host, chosen, PROGRAMS))
    assert "# /etc/systemd/system/mkdaemon.service (changes)" in list(preview(host, chosen, Path("/other/bin")))
    lines = words_of(remove_units(host, chosen))
    assert lines[0] == "typed systemctl disable --now mkdaemon"
    assert units_of(host) == []
    assert not (host.root / "etc/udev/rules.d/60-mkdaemon.rules").exists()
    first, *_ = words_of(remove_units(host, chosen))
    assert first == "/etc/systemd/system/mkdaemon.service is not there"


def test_many_aircraft_share_a_template_that_the_last_one_takes_away(host):
    first, second = (plan(("daemon",), name, "") for name in ("mk1", "mk2"))
    for chosen in (first, second):
        (settings := host.at(chosen[0].settings)).parent.mkdir(parents=True, exist_ok=True)
        settings.write_text("", encoding="utf-8")
        *_, last = words_of(write_units(host, chosen, PROGRAMS))
        assert last == f"next: sudo systemctl enable --now {chosen[0].instance}"
    wanted = host.root / FOLDER / "multi-user.target.wants"
    wanted.mkdir()
    for name in ("mkdaemon@mk1.service", "mkdaemon@mk2.service", "mkdaemon-gateway@ros2.service"):
        (wanted / name).symlink_to("../mkdaemon@.service")
    assert units_of(host) == ["mkdaemon@.service"]
    kept = "/etc/systemd/system/mkdaemon@.service stays: mkdaemon@mk2.service is enabled"
    assert kept in words_of(remove_units(host, first))
    (wanted / "mkdaemon@mk1.service").unlink()
    assert "removed /etc/systemd/system/mkdaemon@.service" in words_of(remove_units(host, second))
    assert units_of(host) == []


def test_a_unit_written_by_hand_is_left_alone(host):
    unit = host.root / FOLDER / "mkdaemon.service"
    unit.parent.mkdir(parents=True)
    unit.write_text("[Unit]\n", encoding="utf-8")
    chosen = plan(("daemon", "recorder"), None, "")
    with pytest.raises(ConfigError, match="written by hand"):
        words_of(write_units(host, chosen, PROGRAMS))
    assert units_of(host) == ["mkdaemon.service"]
    assert "written by hand: needs --force" in "\n".join(preview(host, chosen, PROGRAMS))
    words_of(write_units(host, chosen, PROGRAMS, force=True))
    assert unit.read_text(encoding="utf-8").startswith(MARK)


def test_a_command_that_failed_is_told_by_the_exit_code(host, monkeypatch, capsys):
    module = "mkdaemon.cli.mkdaemon.service.installing.Host"
    words = ["install-service", "recorder", "--programs", "/opt/x/bin", "--write"]
    monkeypatch.setattr(module, lambda: host)
    assert run(app, words) == 0
    monkeypatch.setattr(module, lambda: Host(host.root, lambda words: CommandOutput(1, "")))
    assert run(app, words) == 1
    assert "FAILED: systemctl daemon-reload (exit code 1)" in capsys.readouterr().out


def test_the_link_to_the_current_installation_goes_before_its_folder(host, monkeypatch):
    installed = host.root / "opt/mkdaemon-abc/.venv/bin"
    installed.mkdir(parents=True)
    monkeypatch.setattr("sysconfig.get_path", lambda name: str(installed))
    assert programs_folder(host) == installed
    (host.root / "opt/mkdaemon").symlink_to("mkdaemon-abc")
    assert programs_folder(host) == PROGRAMS
    (host.root / "opt/mkdaemon").unlink()
    (host.root / "opt/mkdaemon").symlink_to("mkdaemon-other")
    assert programs_folder(host) == installed


def test_the_command_shows_by_default(capsys):
    assert run(app, ["install-service", "recorder", "--programs", "/opt/x/bin"]) == 0
    assert "ExecStart=/opt/x/bin/mkctl log record" in capsys.readouterr().out
    assert run(app, ["install-service", "--programs", "/home/me/bin"]) == 2
    assert "may look below /home" in capsys.readouterr().err
    assert run(app, ["install-service", "--vehicle", "../x"]) == 2
    assert run(app, ["install-service", "gateway", "--gateway", "smtp"]) == 2
    assert "there is foxglove, ros2, mavlink" in capsys.readouterr().err
    assert run(app, ["install-service", "--write", "--remove"]) == 2
