"""What the doctor finds on machines made for the purpose, one for each fault, and what it asks of a daemon."""

from __future__ import annotations

import asyncio
import json
import os
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import pytest
import zenoh

from lab.rigs.processes import connected
from mkdaemon.bus.gateway import Bus
from mkdaemon.bus.session import session_config
from mkdaemon.cli.mkdaemon.doctor.check import Needs, Severity
from mkdaemon.cli.mkdaemon.doctor.command import run_doctor
from mkdaemon.cli.mkdaemon.doctor.daemonreport import NO_DAEMON, ask_daemon
from mkdaemon.cli.mkdaemon.doctor.machine import Machine, installed_version, may_use
from mkdaemon.cli.mkdaemon.doctor.table import CHECKS
from mkdaemon.cli.mkdaemon.security import certificates
from mkdaemon.cli.mkdaemon.security.roles import zenoh_file
from mkdaemon.cli.mkdaemon.service.units import UNITS, unit_text
from mkdaemon.cli.systemcommands import CommandOutput, run_command
from mkdaemon.config.reader import load
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.link import LinkCondition, LinkState
from mkdaemon.telemetry.preflight import Blocks, CheckState, Finding, PreflightReport
from mkdaemon.telemetry.record import RecorderState, RecordStatus
from mkdaemon.telemetry.status import Status
from mkdaemon.telemetry.vehicle import VehicleHealth
from mkdaemon.telemetry.vision import EyeState, VisionStats
from tests.bus.support import bus_config, free_endpoint
from tests.cli.sickbay import CALIBRATION, NOW, PORT, Tree
from tests.values import made

ADAPTER = "/sys/devices/pci0/usb1/1-1"
V4L2 = "v4l2-ctl --device /dev/video0 --list-formats-ext"


def line_of(**changes):
    usual = {"condition": LinkCondition.UP, "reason": "both directions proven", "port": PORT, "baud": 57600}
    return LinkState.model_construct(**{**usual, **changes})


def eye_of(**changes):
    return VisionStats.model_construct(**{"camera": "down", "state": EyeState.OK, "reason": "", "fps": 29.8, **changes})


def recorder_of(state, reason=""):
    return RecordStatus.model_construct(state=state, reason=reason)


def stand(tree, token, *words):
    tree.tell(standing={token: words})


@pytest.fixture
def tree(tmp_path, monkeypatch):
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", "/var/lib")
    return Tree(tmp_path / "root", tmp_path / "aircraft.toml")


def run_minicom(tree):
    tree.start(812, "minicom", "minicom", "-D", "/dev/ttyUSB0", files=["/dev/ttyUSB0"])


def lock_port(tree):
    state = (tree.root / "dev/ttyUSB0").stat()
    place = f"{os.major(state.st_dev):02x}:{os.minor(state.st_dev):02x}:{state.st_ino}"
    tree.start(813, "gpsd")
    tree.write("/proc/locks", f"1: FLOCK  ADVISORY  WRITE 813 {place} 0 EOF\n")


def write_lock_file(tree):
    tree.start(814, "picocom")
    tree.write("/run/lock/LCK..ttyUSB0", "       814\n")


def plug_in_without_driver(tree):
    tree.write("/sys/devices/pci0/usb1/1-2/idVendor", "1a86\n")
    tree.write("/sys/devices/pci0/usb1/1-2/product", "USB Serial\n")
    tree.link("/sys/bus/usb/devices/1-2", "/sys/devices/pci0/usb1/1-2")


def share_bus(tree):
    tree.write("/sys/devices/pci0/usb2/2-1/busnum", "1\n")


def listen_by(tree, name, *words):
    tree.listen(7447)
    tree.start(900, name, *words, files=["socket:[77]"])


def run_two_daemons(tree):
    for number in (901, 902):
        tree.start(number, "mkdaemon", "/usr/bin/python3", "/opt/mkdaemon/bin/mkdaemon", "run", "--config", "a.toml")


def keep_certificate(tree, date):
    folder = tree.config.parent
    for name in ("ca.pem", "daemon.pem", "daemon.key"):
        (folder / name).write_text("", encoding="utf-8")
        (folder / name).chmod(0o600)
    file = folder / "tls.json5"
    tls = {"root_ca_certificate": "ca.pem", "listen_certificate": "daemon.pem", "listen_private_key": "daemon.key"}
    paths = {key: str(folder / value) for key, value in tls.items()}
    file.write_text(json.dumps({"transport": {"link": {"tls": paths}}}), encoding="utf-8")
    tree.configure(bus=f'zenoh_file = "{file}"')
    for name in ("ca.pem", "daemon.pem"):
        end = date if name == "daemon.pem" else "Jun  1 12:00:00 2030 GMT"
        words = f"openssl x509 -enddate -noout -in {folder / name}"
        tree.commands[words] = CommandOutput(0, f"notAfter={end}\n")


def certify(tree, days, mode=0o600):
    now = datetime.fromtimestamp(NOW, UTC)
    authority = certificates.make_authority(now)
    pair = certificates.issue_certificate(authority, "pilot", "alice", now=now, days=days)
    fields = certificates.tls_fields(authority.certificate, pair, "pilot")
    file = tree.config.with_name("pilot.json5")
    file.write_text(zenoh_file("pilot", fields, "alice"), encoding="utf-8")
    file.chmod(mode)
    tree.configure(bus=f'zenoh_file = "{file}"')


def open_key(tree):
    keep_certificate(tree, "Jun  1 12:00:00 2030 GMT")
    (tree.config.parent / "daemon.key").chmod(0o644)


def calibrate(tree, old, new):
    assert old in CALIBRATION
    tree.config.with_name("camera.toml").write_text(CALIBRATION.replace(old, new), encoding="utf-8")


def fail_service(tree):
    tree.write("/etc/systemd/system/mkdaemon@.service")
    words = "systemctl list-units --failed --plain --no-legend mkdaemon*"
    tree.commands[words] = CommandOutput(0, "mkdaemon@mk1.service loaded failed failed MikroKopter daemon of mk1\n")


def install_units(tree, options=""):
    for name in UNITS:
        text = unit_text(name)
        tree.write(f"/etc/systemd/system/{name}", text.replace("run --config", f"run{options} --config"))


def no_service(tree):
    tree.answers(follows_server=lambda: False)
    for name in ("comm", "cmdline"):
        tree.write(f"/proc/300/{name}", "agetty" if name == "comm" else "")


def set_kernel(tree, name, value):
    tree.write(f"/proc/sys/kernel/{name}", value)


FAULTS = [  # the check, what is done to the machine, what is found, and the command where it is made of it
    ("configuration", lambda t: t.configure("nap = 1"), "unknown key"),
    ("configuration", lambda t: t.configure(calibration='calibration = "none.toml"'), "camera file none.toml"),
    ("port-unset", lambda t: t.configure(port='""'), "names no port"),
    ("no-adapter", lambda t: (t.configure(port='""'), t.remove("/dev/ttyUSB0")), "no USB serial adapter"),
    ("port-missing", lambda t: t.configure(port='"/dev/ttyUSB7"'), "/dev/ttyUSB7 does not"),
    (
        "port-forbidden",
        lambda t: (t.write("/dev/pts/4"), t.forbidden.add("/dev/pts/4"), t.configure(port='"pty:/dev/pts/4"')),
        "pilot may not open /dev/pts/4",
    ),
    ("port-busy", run_minicom, "in use by minicom (process 812)"),
    ("port-busy", lock_port, "in use by gpsd (process 813)"),
    ("port-busy", write_lock_file, "in use by picocom (process 814)"),
    ("port-console", lambda t: t.write("/proc/cmdline", "console=ttyUSB0,115200 quiet\n"), "the kernel writes"),
    ("port-console", lambda t: t.start(700, "agetty", "/sbin/agetty", "-L", "ttyUSB0"), "a login waits"),
    (
        "port-name",
        lambda t: t.configure(port='"/dev/ttyUSB0"'),
        "/dev/ttyUSB0 is not a stable name",
        f"sed -i 's|/dev/ttyUSB0|{PORT}|'",
    ),
    ("ftdi-latency", lambda t: t.write(f"{ADAPTER}/1-1:1.0/ttyUSB0/latency_timer", "16\n"), "by 16 ms"),
    ("usb-sleep", lambda t: t.write(f"{ADAPTER}/power/control", "auto\n"), "may suspend the adapter"),
    ("adapter-driver", plug_in_without_driver, "USB Serial is plugged in"),
    ("brltty", lambda t: t.start(600, "brltty"), "brltty (process 600)"),
    ("brltty", lambda t: t.write("/usr/lib/udev/rules.d/85-brltty.rules"), "85-brltty.rules starts it"),
    ("modem-manager", lambda t: t.start(601, "ModemManager"), "ModemManager runs"),
    ("baud", lambda t: t.configure(baud="115200"), "link.baud is 115200", "sed -i 's/^baud *= *115200/baud = 57600/'"),
    (
        "packages",
        lambda t: t.answers(
            installed_version=lambda name: "1.6.9" if name == "eclipse-zenoh" else installed_version(name)
        ),
        "eclipse-zenoh is 1.6.9",
    ),
    ("load", lambda t: t.write("/proc/loadavg", "3.50 1.0 0.5 4/99 7\n"), "3.50 on 2 cores"),
    ("one-core", lambda t: t.write("/proc/self/status", "CapEff:\t0\nCpus_allowed_list:\t3\n"), "one core"),
    (
        "governor",
        lambda t: t.write("/sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave\n"),
        "the CPU governor of cpu1",
    ),
    (
        "real-time",
        lambda t: t.write("/proc/self/limits", "Max realtime priority     0                    0\n"),
        "pilot may not use real-time",
        r"printf 'pilot - rtprio 2\npilot - nice -10\n' | sudo tee /etc/security",
    ),
    ("autogroup", lambda t: set_kernel(t, "sched_autogroup_enabled", "1"), "by session"),
    ("real-time-bound", lambda t: set_kernel(t, "sched_rt_runtime_us", "-1"), "real-time programs have no limit"),
    ("memory", lambda t: t.write("/proc/meminfo", "MemAvailable:    90000 kB\n"), "90 MB"),
    ("heat", lambda t: t.write("/sys/class/thermal/thermal_zone0/temp", "84500\n"), "cpu-thermal is at 84 degrees"),
    ("voltage", lambda t: t.write("/sys/class/hwmon/hwmon1/in0_lcrit_alarm", "1\n"), "supply voltage is too low"),
    ("disk-full", lambda t: t.answers(free_bytes=lambda path: 9_000_000), "9 MB are free"),
    ("disk-short", lambda t: t.answers(free_bytes=lambda path: 700_000_000), "record.free_mb reserves 1000"),
    ("folder", lambda t: t.forbidden.add("/var/lib/records"), "may not write in /var/lib/records"),
    ("no-time-service", no_service, "no time service runs"),
    ("clock-free", lambda t: t.answers(follows_server=lambda: False), "does not follow a time server yet"),
    ("clock-unset", lambda t: t.answers(wall=lambda: 5.0), "days before"),
    ("clock-skew", lambda t: t.tell(clock=NOW - 7.5), "6.5 s behind"),
    ("clock-skew", lambda t: t.tell(clock=NOW + 3.0), "3.0 s ahead of"),
    ("service-failed", fail_service, "mkdaemon@mk1.service has failed"),
    (
        "service-old",
        lambda t: (install_units(t, " --gone"), t.remove("/etc/systemd/system/mkdaemon@.service")),
        "/etc/systemd/system/mkdaemon.service is of another release",
    ),
    ("endpoint", lambda t: listen_by(t, "nginx"), "taken by nginx (process 900)"),
    (
        "endpoint-daemon",
        lambda t: (
            listen_by(t, "mkdaemon", "/opt/mkdaemon/bin/mkdaemon", "run", "--config", "other.toml"),
            t.tell(daemons=0, clock=None),
        ),
        "tcp/127.0.0.1:7447 is used by mkdaemon (process 900), which does not serve mk1",
    ),
    ("endpoint-daemon", lambda t: (t.listen(7447), t.tell(daemons=0, clock=None)), "used by a program of another user"),
    ("second-daemon", run_two_daemons, "processes 901 and 902"),
    ("vehicle-twice", lambda t: t.tell(daemons=2), "2 daemons at tcp/127.0.0.1:7447 serve mk1"),
    (
        "bus",
        lambda t: t.tell(failure="a program listens but does not answer", daemons=0, clock=None),
        "a program listens but does not answer",
    ),
    ("zenoh-version", lambda t: t.tell(routers=("v0.11.0",)), "router is v0.11.0"),
    (
        "open-bus",
        lambda t: t.configure(bus='listen = ["tcp/0.0.0.0:7447"]\nallow_open = true'),
        "tcp/0.0.0.0:7447 lets every program",
    ),
    ("certificate", lambda t: keep_certificate(t, "Jun  1 12:00:00 2026 GMT"), "daemon.pem expires in 4 days"),
    ("certificate", lambda t: keep_certificate(t, "Jun  1 12:00:00 2025 GMT"), "has expired"),
    ("certificate", lambda t: certify(t, days=12), "pilot.json5 expires in 12 days"),
    ("private-key", lambda t: certify(t, days=300, mode=0o644), "can read the private key"),
    ("private-key", open_key, "every user of this machine"),
    ("camera-missing", lambda t: t.remove("/dev/video0"), "/dev/video0 does not exist"),
    ("camera-forbidden", lambda t: t.forbidden.add("/dev/video0"), "pilot may not open /dev/video0"),
    ("camera-busy", lambda t: t.start(820, "cheese", files=["/dev/video0"]), "in use by cheese"),
    ("camera-node", lambda t: t.write("/sys/class/video4linux/video0/index", "1\n"), "/dev/video0 delivers no images"),
    (
        "camera-rate",
        lambda t: t.commands.update(
            {V4L2: CommandOutput(0, "Size: Discrete 1280x720\n Interval: 0.1s (10.000 fps)\n")}
        ),
        "set to 30 images a second, but delivers at most 10",
    ),
    ("camera-slow", lambda t: t.tell(eyes=(eye_of(fps=7.4),)), "delivers 7 images a second instead of 30"),
    (
        "camera-state",
        lambda t: t.tell(eyes=(eye_of(state=EyeState.SILENT, reason="No image for 1 s: check its cable."),)),
        "camera down is silent",
    ),
    ("calibration-none", lambda t: t.configure(calibration=""), "has no calibration"),
    ("calibration-poor", lambda t: calibrate(t, "rms_px = 0.3", "rms_px = 2.5"), "its error is 2.5 px"),
    ("calibration-poor", lambda t: calibrate(t, "focal_sd_percent = 0.1", "focal_sd_percent = 4.0"), "known to 4 %"),
    (
        "calibration-poor",
        lambda t: calibrate(t, "views = 30", "views = 3\nforced = true"),
        "stored although it is poor",
    ),
    ("calibration-old", lambda t: calibrate(t, "2026-05-01", "2023-05-01"), "is 1124 days old"),
    ("calibration-size", lambda t: t.configure(width="640", height="480"), "set to 640x480, but"),
    ("usb-shared", share_bus, "share USB bus 1 of 480 Mbit/s"),
    (
        "line-rate",
        lambda t: t.tell(line=line_of(condition=LinkCondition.GARBAGE, reason="bytes come, none of them a frame")),
        "but no valid frame",
    ),
    ("line", lambda t: t.tell(line=line_of(condition=LinkCondition.MUTE, reason="nothing arrives")), "is mute"),
    ("line-baud", lambda t: t.tell(line=line_of(baud=38400)), "at 38400 baud", "sed -i"),
    (
        "gate",
        lambda t: stand(t, "gate_constant", "gate", "ExternalControl is 200, a constant.", "Put it on a switch."),
        "ExternalControl is 200, a constant",
    ),
    (
        "height-control",
        lambda t: stand(t, "height_control", "height control", "bit 0 of GlobalConfig allows it", "Clear it."),
        "bit 0 of GlobalConfig",
    ),
    (
        "preflight",
        lambda t: stand(t, "battery_low", "battery", "the battery is low: 10.8 V.", "Land and change the battery."),
        "the battery is low",
    ),
    ("recorder", lambda t: t.tell(recorder=recorder_of(RecorderState.FULL, "0 MB are free")), "does not record (full)"),
]


ALSO = {
    "configuration": {"adapter-driver"},
    "no-adapter": {"port-unset", "port-missing"},
    "certificate": {"configuration"},
}
"""What a fault brings with it."""


def test_a_healthy_machine_is_quiet(tree):
    install_units(tree)
    seen = tree.examined()
    assert seen.findings == ()
    assert seen.unseen.keys() == {Needs.DAEMON}
    assert seen.worst() is None


def test_a_healthy_machine_with_a_running_daemon_is_quiet(tree):
    routers = (f"v{installed_version('eclipse-zenoh')}-g1",)
    recorder = recorder_of(RecorderState.RECORDING)
    tree.tell(line=line_of(), recorder=recorder, eyes=(eye_of(),), routers=routers, clock=NOW - 0.5)
    words = ("/opt/mkdaemon/bin/mkdaemon", "run")
    tree.start(901, "mkdaemon", "python3", *words, "--config", "a.toml", files=["/dev/ttyUSB0", "socket:[77]"])
    tree.start(902, "mkdaemon", "python3", *words, "--config", "b.toml")
    guard = "/opt/mkdaemon/lib/mkdaemon/guard.py"
    tree.start(903, "python3", "python3", "-I", "-S", guard, "7", files=["/dev/ttyUSB0"])
    seen = tree.examined()
    assert (seen.findings, seen.unseen) == ((), {})


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault[0]}: {fault[2]}")
def test_a_fault_is_found_with_what_why_and_the_command(tree, fault):
    check, seed, words, *command = fault
    seed(tree)
    found = tree.examined().findings
    (finding,) = [finding for finding in found if finding.check == check]
    assert words in finding.what
    assert finding.why
    assert finding.fix
    assert not command or command[0] in finding.command
    assert "{" not in finding.what + finding.why + finding.fix + finding.command
    others = {finding.check for finding in found} - {check}
    assert others <= ALSO.get(check, set())


def test_every_check_has_a_seeded_fault_and_a_name_of_its_own():
    assert {check for check, *_ in FAULTS} == {check.name for check in CHECKS}
    assert max(Counter(check.name for check in CHECKS).values()) == 1


def run_and_read(tree, capsys, **options):
    code = run_doctor(tree.machine, tree.config, must_fix=options.get("fix", False), as_json=options.get("json", False))
    return code, capsys.readouterr().out


def test_the_exit_code_tells_the_severity(tree, capsys):
    assert run_and_read(tree, capsys) == (
        0,
        f"nothing found by {len(CHECKS)} checks; 13 see nothing without a running daemon\n",
    )
    set_kernel(tree, "sched_autogroup_enabled", "1")
    assert run_and_read(tree, capsys)[0] == 0
    tree.write("/proc/loadavg", "9 9 9 1/9 9\n")
    assert run_and_read(tree, capsys)[0] == 3
    tree.remove("/dev/video0")
    code, out = run_and_read(tree, capsys)
    assert code == 1
    assert out.splitlines()[0].startswith("error   camera-missing: camera down: /dev/video0 does not exist")
    assert "\n1 error, 1 warning, 1 advice by " in out


def test_fix_types_what_is_safe_and_nothing_else(tree, capsys):
    timer = tree.write(f"{ADAPTER}/1-1:1.0/ttyUSB0/latency_timer", "16\n")
    run_minicom(tree)
    typed = []

    def run(words):
        if words[0] == "sh":
            typed.append(words[2])
            return run_command(["sh", "-c", words[2].replace("sudo ", "")])
        return CommandOutput(127, "")

    tree.answers(run=run)
    code, out = run_and_read(tree, capsys, fix=True)
    assert [words.replace("sudo ", "") for words in typed] == [
        f"echo 1 | tee {tree.root}/sys/class/tty/ttyUSB0/device/latency_timer"
    ]
    assert timer.read_text(encoding="utf-8") == "1\n"
    assert code == 1
    assert out.startswith("typed: echo 1 | ")
    assert "ftdi-latency" not in out.partition("\n")[2]
    assert "port-busy" in out


def test_what_cannot_be_mended_is_told(tree, capsys):
    set_kernel(tree, "sched_rt_runtime_us", "-1")
    code, out = run_and_read(tree, capsys, fix=True)
    assert code == 3
    assert out.startswith("FAILED: ")
    _, out = run_and_read(tree, capsys, fix=True, json=True)
    assert json.loads(out.splitlines()[0])["is_done"] is False


def test_safe_commands_end_no_program_and_write_no_configuration():
    for check in CHECKS:
        if check.is_safe:
            assert not any(word in check.command for word in ("kill", "sed -i", "install", "rm ", "apt", "usermod"))
    assert any(check.is_safe for check in CHECKS)
    assert {check.severity for check in CHECKS} == set(Severity)


def test_this_machine_can_be_looked_at():
    """Its processes, sockets and files as they are; what is wrong with it is its own affair."""
    machine = Machine()
    me = Path("/proc/self/cmdline")
    if not me.exists():
        pytest.skip("no /proc here: nothing to look at")
    assert all(process.number != os.getpid() for process in machine.processes)
    assert machine.listeners is machine.listeners
    assert machine.holders(Path("/dev/null")) is not None
    assert may_use(Path("/dev/null"))
    assert run_command(["no-such-command"]) == CommandOutput(127, "")
    assert run_command(["sh", "-c", "echo x; exit 4"]) == CommandOutput(4, "x\n")


LINE = made(LinkState)


def finding(name, token, blocks=Blocks.AUTONOMY):
    state = CheckState.PASSED if token is None else CheckState.STANDS
    return Finding(name=name, state=state, blocks=blocks, token=token, reason=f"{name} is so", fix="mend it")


FOUND = (finding("gate", "gate_constant"), finding("advice", "watch_it", Blocks.NOTHING), finding("disk", None))


@pytest.fixture
async def endpoint():
    """A router that describes itself, and a daemon that is connected to it."""
    where = free_endpoint()
    more = {"adminspace/enabled": True}
    router = await asyncio.to_thread(zenoh.open, session_config("router", listen=[where], more=more))

    async def preflight(suffix, payload):
        report = PreflightReport(is_ready=False, findings=FOUND)
        return CommandResult(status=Status.ACCEPTED, reply=report.model_dump(mode="json"))

    async with Bus.open(bus_config(free_endpoint(), connect=(where,)), "t1") as bus:
        bus.serve("do", preflight)
        bus.publish("health", made(VehicleHealth, is_alive=True))
        bus.publish("link/state", LINE)
        bus.publish("vision/down/stats", LINE)  # of no kind that this release knows
        bus.announce()
        async with connected(where, "t1"):
            pass  # the router has heard of the daemon
        yield where
    await asyncio.to_thread(router.close)


async def test_a_daemon_and_a_router_are_asked(endpoint):
    cfg = load(None, {"vehicle.name": "t1"})
    report = await asyncio.to_thread(ask_daemon, cfg, [endpoint])
    assert (report.failure, report.daemons) == ("", 1)
    assert report.clock is not None
    assert report.line == LINE
    assert report.eyes == ()
    assert report.standing == {"gate_constant": ("gate", "gate is so", "mend it")}
    assert report.routers
    assert all(version.lstrip("v")[0].isdigit() for version in report.routers), json.dumps(report.routers)


async def test_nobody_is_asked_without_the_certificate_that_is_needed(monkeypatch):
    monkeypatch.delenv("MK_ZENOH_FILE", raising=False)
    assert await asyncio.to_thread(ask_daemon, load(None), ["tls/127.0.0.1:1"]) == NO_DAEMON


async def test_nobody_there_is_told_with_the_reason():
    report = await asyncio.to_thread(ask_daemon, load(None), ["tcp/127.0.0.1:1"])
    assert "no program answers at tcp/127.0.0.1:1" in report.failure
    assert report.daemons == 0
