"""What the doctor finds on machines made for the purpose."""

from __future__ import annotations

import json
import os
import pty
import socket

import pytest

from mkdaemon.cli.mkdaemon.doctor import Machine, Verdict, doctor, examine
from tests.places import CONFIGS


@pytest.fixture
def machine(tmp_path):
    for name in ("dev", "sys", "run", "proc"):
        (tmp_path / name).mkdir()
    return Machine(tmp_path / "dev", tmp_path / "sys", tmp_path / "run", tmp_path / "proc")


def findings(machine, config=None):
    return {(finding.what, finding.verdict): finding for finding in examine(machine, config)}


def plug_in(machine, name="ttyUSB0", timer=None):
    """A serial adapter, which is a pseudo terminal here; returns its far end's name."""
    near, far = pty.openpty()
    (machine.dev / name).symlink_to(os.ttyname(far))
    if timer is not None:
        folder = machine.sys / "class" / "tty" / name / "device"
        folder.mkdir(parents=True)
        (folder / "latency_timer").write_text(f"{timer}\n", encoding="ascii")
    return near, far


def test_an_empty_machine_is_told_what_to_plug_in(machine):
    found = findings(machine)[("serial ports", Verdict.NOTE)]
    assert "no USB serial adapter" in found.found
    assert "mkdaemon demo" in found.fix


def test_a_good_adapter(machine):
    ends = plug_in(machine, timer=1)
    found = findings(machine)
    assert ("serial port", Verdict.GOOD) in found
    assert ("FTDI latency timer", Verdict.GOOD) in found
    for descriptor in ends:
        os.close(descriptor)


def test_a_slow_latency_timer_is_noted_with_the_command_that_helps(machine):
    ends = plug_in(machine, timer=16)
    found = findings(machine)[("FTDI latency timer", Verdict.NOTE)]
    assert "16 ms" in found.found
    assert "tee" in found.fix
    for descriptor in ends:
        os.close(descriptor)


def test_a_port_another_program_locked_is_bad(machine):
    import fcntl

    near, far = plug_in(machine)
    fcntl.flock(far, fcntl.LOCK_EX)
    assert "in use" in findings(machine)[("serial port", Verdict.BAD)].found
    for descriptor in (near, far):
        os.close(descriptor)


def test_a_port_without_permission_names_the_group(machine, monkeypatch):
    ends = plug_in(machine)
    monkeypatch.setattr(os, "access", lambda *_: False)
    found = findings(machine)[("serial port", Verdict.BAD)]
    assert "may not be opened" in found.found
    assert "usermod -aG" in found.fix
    for descriptor in ends:
        os.close(descriptor)


def test_configuration_endpoint_and_device_are_checked(machine, tmp_path):
    path = tmp_path / "x.toml"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        path.write_text(
            f'[link]\nport = "/dev/no-such-port"\n'
            f'[bus]\nlisten = ["tcp/127.0.0.1:{port}", "tcp/0.0.0.0:0"]\nallow_open = true\n'
            f'[[cameras]]\nsource = "/dev/video9"\ntargets = ["{CONFIGS}/targets/nested.toml"]\n',
            encoding="utf-8",
        )
        found = list(examine(machine, path))
    text = "\n".join(f"{finding.verdict} {finding.found}" for finding in found)
    assert "good " + str(path) in text
    assert "bad /dev/no-such-port does not exist" in text
    assert f"note tcp/127.0.0.1:{port} cannot be listened on" in text
    assert "note tcp/0.0.0.0:0 lets the whole network fly the aircraft" in text
    assert "has no calibration" in text


def test_a_wrong_configuration_is_bad(machine, tmp_path):
    path = tmp_path / "x.toml"
    path.write_text("[lnk]\n", encoding="utf-8")
    assert 'did you mean "link"' in findings(machine, path)[("configuration", Verdict.BAD)].found


def test_the_report_of_this_machine_is_readable_and_its_exit_code_says_so(capsys):
    code = doctor(as_json=True)
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert code == int(any(line["verdict"] == "bad" for line in lines))
    doctor()
    assert "bus" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("synchronised", "verdict", "words"),
    [(True, Verdict.GOOD, "follows a time server"), (False, Verdict.NOTE, "cannot be compared"), (None, None, "")],
)
def test_the_clock_is_judged_as_every_stamp_judges_it(machine, monkeypatch, synchronised, verdict, words):
    monkeypatch.setattr("mkdaemon.cli.mkdaemon.doctor.kernel_synchronised", lambda: synchronised)
    found = [finding for finding in examine(machine, None) if finding.what == "clock"]
    assert [finding.verdict for finding in found] == ([] if verdict is None else [verdict])
    assert all(words in finding.found for finding in found)


@pytest.mark.parametrize(
    ("load", "verdict", "words"),
    [("0.10 0.2 0.3 1/99 7", Verdict.GOOD, "2 cores"), ("3.50 1.0 0.5 4/99 7", Verdict.NOTE, "load 3.5 on 2 cores")],
)
def test_a_busy_machine_is_told_before_it_keeps_the_daemon_waiting(machine, monkeypatch, load, verdict, words):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    (machine.proc / "loadavg").write_text(f"{load}\n", encoding="ascii")
    assert words in findings(machine)[("processor", verdict)].found


def test_missing_rights_and_autogroup_come_with_the_command_that_mends(machine, monkeypatch):
    monkeypatch.setattr("mkdaemon.cli.mkdaemon.doctor.may_be_real_time", lambda: False)
    (machine.proc / "sys" / "kernel").mkdir(parents=True)
    (machine.proc / "sys" / "kernel" / "sched_autogroup_enabled").write_text("1\n", encoding="ascii")
    found = findings(machine)
    assert "- rtprio 2" in found[("real time", Verdict.NOTE)].fix
    assert "sudo sysctl -p" in found[("autogroup", Verdict.NOTE)].fix
    monkeypatch.setattr("mkdaemon.cli.mkdaemon.doctor.may_be_real_time", lambda: True)
    (machine.proc / "sys" / "kernel" / "sched_autogroup_enabled").write_text("0\n", encoding="ascii")
    found = findings(machine)
    assert ("real time", Verdict.GOOD) in found
    assert not any(what == "autogroup" for what, _ in found)


def test_one_core_is_too_few_for_a_camera(machine, monkeypatch, tmp_path):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0})
    path = tmp_path / "x.toml"
    path.write_text('[[cameras]]\nsource = "/dev/video9"\n', encoding="utf-8")
    assert "holds up the control loop" in findings(machine, path)[("processor", Verdict.NOTE)].found
