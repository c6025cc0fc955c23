"""What the doctor finds on machines made for the purpose."""

from __future__ import annotations

import json
import os
import pty
import socket

import pytest

from mkdaemon.cli.mkdaemon.doctor import Machine, Verdict, doctor, examine


@pytest.fixture
def machine(tmp_path):
    for name in ("dev", "sys", "run"):
        (tmp_path / name).mkdir()
    return Machine(tmp_path / "dev", tmp_path / "sys", tmp_path / "run")


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
            f'[link]\nport = "/dev/no-such-port"\n[bus]\nlisten = ["tcp/127.0.0.1:{port}", "tcp/0.0.0.0:0"]\n'
            '[[cameras]]\nsource = "/dev/video9"\n',
            encoding="utf-8",
        )
        found = list(examine(machine, path))
    text = "\n".join(f"{finding.verdict} {finding.found}" for finding in found)
    assert "good " + str(path) in text
    assert "bad /dev/no-such-port does not exist" in text
    assert f"note tcp/127.0.0.1:{port} cannot be listened on" in text
    assert "bad tcp/0.0.0.0:0 lets the whole network fly the aircraft" in text
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
