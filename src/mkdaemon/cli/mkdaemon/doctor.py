"""`mkdaemon doctor`: what on this machine stands between us and an aircraft."""

from __future__ import annotations

import fcntl
import getpass
import grp
import os
import shutil
import socket
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from cyclopts import Parameter
from rich.text import Text

from mkdaemon.bus.exposure import open_endpoints
from mkdaemon.bus.session import session_config
from mkdaemon.cli.arguments import AsJson
from mkdaemon.cli.console import Console
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.clock import kernel_synchronised
from mkdaemon.config.bus import BusConfig
from mkdaemon.config.reader import load
from mkdaemon.config.root import Config
from mkdaemon.daemon.priority import CORES, may_be_real_time
from mkdaemon.daemon.runnable import mistakes
from mkdaemon.errors import ConfigError
from mkdaemon.link.ports.port import parse_address

FTDI_DELAY_MS: Final = 2
"""Longest latency timer that is good enough [ms]; the chip's default of 16 delays every frame by up to that."""

BUSY: Final = 0.7
"""Load a core above which the machine counts as busy."""
LIMITS: Final = "/etc/security/limits.d/60-mkdaemon.conf"
"""Where a user is granted real-time rights; limits.conf(5)."""
SYSCTL: Final = "/etc/sysctl.d/60-mkdaemon.conf"
"""Where the kernel is told at every start; sysctl.d(5)."""


class Verdict(StrEnum):
    """What a check found."""

    GOOD = "good"
    NOTE = "note"
    BAD = "bad"


class Finding(NamedTuple):
    """One line of the report.

    Attributes:
        verdict: good, note (works, could be better) or bad (will not work).
        what: what was looked at.
        found: what was seen.
        fix: what to do; empty where nothing.
    """

    verdict: Verdict
    what: str
    found: str
    fix: str = ""


class Machine(NamedTuple):
    """Where the checks look; a test gives it another root.

    Attributes:
        dev: device nodes.
        sys: sysfs.
        run: runtime state of services.
        proc: of the kernel.
    """

    dev: Path = Path("/dev")
    sys: Path = Path("/sys")
    run: Path = Path("/run")
    proc: Path = Path("/proc")


def doctor(
    *,
    config: Annotated[Path | None, Parameter(name=["--config", "-c"])] = None,
    as_json: AsJson = False,
) -> int:
    """Check this machine: serial ports and who may open them, latency timers, ModemManager, the bus, cameras.

    Nothing is sent to any device. Exit code 0 when nothing stands in the way, 1 otherwise.

    Args:
        config: Also check what this configuration file names.
    """
    findings = list(examine(Machine(), config))
    if as_json:
        for finding in findings:
            print(json_line(finding._asdict()))
    else:
        show(findings, Console())
    return EXIT_FAILURE if any(finding.verdict is Verdict.BAD for finding in findings) else EXIT_OK


def show(findings: Iterable[Finding], console: Console) -> None:
    """Print findings; what they quote from files is text, brackets and all."""
    colours = {Verdict.GOOD: "green", Verdict.NOTE: "yellow", Verdict.BAD: "red"}
    for finding in findings:
        head = (f"{finding.verdict:<4}", colours[finding.verdict])
        console.print(Text.assemble(head, f" {on_one_line(f'{finding.what}: {finding.found}')}"), soft_wrap=True)
        if finding.fix:
            console.print(
                Text(f"     {on_one_line(finding.fix)}", style="dim"), soft_wrap=True
            )  # a command is copied whole


def examine(machine: Machine, config: Path | None) -> Iterator[Finding]:
    """All findings, in the order in which things go wrong."""
    cfg = Config()
    if config is not None:
        try:
            cfg = load(config)
        except ConfigError as error:
            yield Finding(Verdict.BAD, "configuration", str(error), "Correct that line.")
        else:
            yield from _configuration(config, cfg)
    yield from _processor(machine, cfg)
    yield from _serial_ports(machine, cfg)
    yield from _modem_manager(machine)
    yield from _endpoints(cfg.bus)
    yield from _cameras(machine, cfg)
    yield from _clock(kernel_synchronised())


def _configuration(path: Path, cfg: Config) -> Iterator[Finding]:
    """What `mkdaemon run` would refuse, in its words."""
    is_valid = True
    if not cfg.link.port:
        fix = f"Set link.port, or: mkdaemon run --config {path} --port PORT."
        yield Finding(Verdict.NOTE, "link.port", f"{path} names no port", fix)
        cfg = cfg.model_copy(update={"link": cfg.link.model_copy(update={"port": "/dev/null"})})
    for mistake in mistakes(cfg):
        is_valid = False
        yield Finding(Verdict.BAD, "configuration", str(mistake), f"Correct {path}; `mkdaemon run` refuses it so.")
    if is_valid:
        yield Finding(Verdict.GOOD, "configuration", f"{path} is valid")


def _processor(machine: Machine, cfg: Config) -> Iterator[Finding]:
    """Whether the daemon gets a processor when it needs one: a late loop is a late stick frame."""
    cores = len(os.sched_getaffinity(0))
    load_now = _load(machine)
    if load_now is not None and load_now > BUSY * cores:
        found = f"load {load_now:.1f} on {_count(cores, 'core')}: other programs keep the daemon waiting"
        yield Finding(Verdict.NOTE, "processor", found, "`top -o %CPU` shows which; end them before a flight.")
    elif cores < CORES and cfg.cameras:
        found = "one core: looking at an image holds up the control loop"
        yield Finding(Verdict.NOTE, "processor", found, "Use a computer with two cores or more.")
    else:
        yield Finding(Verdict.GOOD, "processor", _count(cores, "core"))
    if may_be_real_time():
        yield Finding(Verdict.GOOD, "real time", "the control loop may go before other programs")
    else:
        user = getpass.getuser()
        lines = rf"{user} - rtprio 2\n{user} - nice -10\n"
        fix = f"printf '{lines}' | sudo tee {LIMITS}, then log in again; the service (configs/systemd/) has it already."
        yield Finding(Verdict.NOTE, "real time", f"{user} may not go before other programs", fix)
    if _read(machine.proc / "sys" / "kernel" / "sched_autogroup_enabled") == "1":
        found = "the kernel shares the processor by session: one busy terminal counts as much as the daemon"
        fix = f"echo 'kernel.sched_autogroup_enabled = 0' | sudo tee {SYSCTL} && sudo sysctl -p {SYSCTL}"
        yield Finding(Verdict.NOTE, "autogroup", found, fix)


def _load(machine: Machine) -> float | None:
    """Processes that run or want to, over the last minute; None where the system does not tell."""
    try:
        return float(_read(machine.proc / "loadavg").split()[0])
    except (IndexError, ValueError):
        return None


def _read(path: Path) -> str:
    """What a file of the kernel says; empty where there is none."""
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return ""


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _serial_ports(machine: Machine, cfg: Config) -> Iterator[Finding]:
    ports = sorted({*machine.dev.glob("ttyUSB*"), *machine.dev.glob("ttyACM*")})
    names = _by_id(machine)
    if not ports:
        yield Finding(
            Verdict.NOTE,
            "serial ports",
            "no USB serial adapter is plugged in",
            "Plug in the radio or cable; without one: mkdaemon demo, mkdaemon sim.",
        )
    for port in ports:
        yield from _access(port, names.get(port.name, ""))
        yield from _latency_timer(machine, port)
    wanted = _device(cfg.link.port)
    if wanted is not None and not wanted.exists():
        near = ", ".join([*names.values()] or [str(port) for port in ports]) or "none"
        yield Finding(Verdict.BAD, "link.port", f"{wanted} does not exist", f"What is there: {near}.")


def _device(port: str) -> Path | None:
    """The device that a port names; None where it names none."""
    with suppress(ConfigError):
        address = parse_address(port)
        return Path(address.target) if address.scheme in ("serial", "pty") else None
    return None


def _by_id(machine: Machine) -> dict[str, str]:
    """The name that survives replugging, by device."""
    folder = machine.dev / "serial" / "by-id"
    return {link.resolve().name: str(link) for link in sorted(folder.glob("*"))} if folder.is_dir() else {}


def _access(port: Path, stable_name: str) -> Iterator[Finding]:
    called = f"{port} ({stable_name})" if stable_name else str(port)
    if not os.access(port, os.R_OK | os.W_OK):
        group = _group_of(port)
        fix = f"sudo usermod -aG {group} {getpass.getuser()}, then log in again."
        yield Finding(Verdict.BAD, "serial port", f"{called} may not be opened by {getpass.getuser()}", fix)
        return
    holder = _held(port)
    if holder is not None:
        yield Finding(Verdict.BAD, "serial port", f"{called} is in use: {holder}", "End the other program.")
        return
    yield Finding(Verdict.GOOD, "serial port", f"{called} may be opened")


def _group_of(port: Path) -> str:
    try:
        return grp.getgrgid(port.stat().st_gid).gr_name
    except (KeyError, OSError):
        return "dialout"


def _held(port: Path) -> str | None:
    """Who holds a port, as far as locks tell; opening is harmless with O_NONBLOCK and no change of modem lines."""
    try:
        descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        return error.strerror
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return "another program has locked it"
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return None


def _latency_timer(machine: Machine, port: Path) -> Iterator[Finding]:
    timer = machine.sys / "class" / "tty" / port.name / "device" / "latency_timer"
    try:
        delay = int(timer.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return  # no FTDI chip
    if delay > FTDI_DELAY_MS:
        fix = f"echo 1 | sudo tee {timer}; for good: configs/udev/60-mkdaemon.rules."
        yield Finding(Verdict.NOTE, "FTDI latency timer", f"{port.name} holds bytes back for {delay} ms", fix)
    else:
        yield Finding(Verdict.GOOD, "FTDI latency timer", f"{port.name}: {delay} ms")


def _modem_manager(machine: Machine) -> Iterator[Finding]:
    if not (machine.run / "systemd" / "system").is_dir() or shutil.which("systemctl") is None:
        return
    state = subprocess.run(
        ["systemctl", "is-active", "ModemManager"], capture_output=True, text=True, check=False, timeout=5
    ).stdout.strip()
    if state == "active":
        yield Finding(
            Verdict.NOTE,
            "ModemManager",
            "runs, and speaks AT commands to every new serial port",
            "Install configs/udev/60-mkdaemon.rules, or: sudo systemctl disable --now ModemManager.",
        )
    else:
        yield Finding(Verdict.GOOD, "ModemManager", "does not run")


def _endpoints(cfg: BusConfig) -> Iterator[Finding]:
    for endpoint in cfg.listen:
        protocol, _, address = endpoint.partition("/")
        host, _, port = address.split("?")[0].rpartition(":")
        if protocol != "tcp" or not port.isdigit():
            continue
        try:
            with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host.strip("[]"), int(port)))
        except OSError as error:
            fix = "Is mkdaemon running already? Otherwise choose another endpoint: bus.listen, --listen."
            yield Finding(Verdict.NOTE, "bus", f"{endpoint} cannot be listened on: {error.strerror}", fix)
        else:
            yield Finding(Verdict.GOOD, "bus", f"{endpoint} is free")
    yield from _exposure(cfg)


def _exposure(cfg: BusConfig) -> Iterator[Finding]:
    """Who in the network can reach the bus."""
    try:
        reachable = ", ".join(open_endpoints(session_config("peer", listen=cfg.listen, zenoh_file=cfg.zenoh_file)))
    except ConfigError:
        return  # told as a mistake of the configuration
    if reachable and cfg.allow_open:
        fix = "Listen on 127.0.0.1, or set up client certificates: configs/zenoh/."
        yield Finding(Verdict.NOTE, "bus", f"{reachable} lets the whole network fly the aircraft", fix)


def _cameras(machine: Machine, cfg: Config) -> Iterator[Finding]:
    nodes = sorted(machine.dev.glob("video*"))
    for node in nodes:
        if os.access(node, os.R_OK | os.W_OK):
            yield Finding(Verdict.GOOD, "camera", f"{node} may be opened")
        else:
            fix = f"sudo usermod -aG video {getpass.getuser()}, then log in again."
            yield Finding(Verdict.BAD, "camera", f"{node} may not be opened by {getpass.getuser()}", fix)
    for camera in cfg.cameras:
        if camera.calibration is None:
            fix = "mkdaemon calibrate camera: without one tags are published, poses never."
            yield Finding(Verdict.NOTE, "camera", f"{camera.name} has no calibration", fix)


def _clock(is_synchronised: bool | None) -> Iterator[Finding]:
    """Stamps in Unix time are compared across machines; a clock nobody sets makes them worthless."""
    if is_synchronised:
        yield Finding(Verdict.GOOD, "clock", "follows a time server")
    elif is_synchronised is not None:
        fix = "sudo timedatectl set-ntp true, or install chrony."
        found = "follows no time server: stamps of two machines cannot be compared"
        yield Finding(Verdict.NOTE, "clock", found, fix)
