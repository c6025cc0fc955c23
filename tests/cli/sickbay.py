"""A machine that does not exist: a tree of /dev, /proc, /sys, and answers of the system, for the doctor to look at."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from mkdaemon.cli.mkdaemon.doctor.daemonreport import NO_DAEMON, DaemonReport
from mkdaemon.cli.mkdaemon.doctor.machine import Machine, installed_version
from mkdaemon.cli.mkdaemon.doctor.table import Examined, examine
from mkdaemon.cli.systemcommands import CommandOutput
from tests.places import CONFIGS

NOW = 1_780_000_000.0
"""2026-05-28, as the machine has it."""
PORT = "/dev/serial/by-id/usb-FTDI_A4007-if00-port0"
CALIBRATION = """
[intrinsics]
fx = 640.0
fy = 640.0
cx = 640.0
cy = 360.0
width = 1280
height = 720
[calibration]
date = "2026-05-01"
views = 30
rms_px = 0.3
focal_sd_percent = 0.1
"""


_VERSION = cache(installed_version)


class Tree:
    """The machine: healthy until something is done to it.

    Attributes:
        root: of its files.
        config: its configuration file.
        commands: what its commands say, by their words.
        typed: commands that were run.
    """

    def __init__(self, root: Path, config: Path) -> None:
        self.root, self.config = root, config
        self.commands: dict[str, CommandOutput] = {}
        self.typed: list[tuple[str, ...]] = []
        self.forbidden: set[str] = set()
        self.report = NO_DAEMON
        self.machine = Machine(
            root=root,
            run=self._run,
            may_use=lambda path: f"/{path.relative_to(root)}" not in self.forbidden,
            free_bytes=lambda path: 50_000_000_000,
            follows_server=lambda: True,
            wall=lambda: NOW,
            installed_at=NOW - 1e6,
            installed_version=_VERSION,
            user="pilot",
            ask=lambda cfg, endpoints: self.report,
        )
        self._plug_in()
        self._boot()
        self.configure()

    def write(self, path: str, text: str = "") -> Path:
        """Make a file of the machine."""
        place = self.root / path.removeprefix("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text, encoding="utf-8")
        return place

    def link(self, path: str, target: str) -> None:
        """Make a symbolic link of the machine, by a relative path as the kernel does."""
        place, aim = self.root / path.removeprefix("/"), self.root / target.removeprefix("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(os.path.relpath(aim, place.parent))

    def remove(self, path: str) -> None:
        """Take a file away."""
        (self.root / path.removeprefix("/")).unlink()

    def start(self, number: int, name: str, *words: str, files: Sequence[str] = ()) -> None:
        """Let a program run that has some files open."""
        self.write(f"/proc/{number}/comm", f"{name}\n")
        self.write(f"/proc/{number}/cmdline", "\0".join(words or (name,)) + "\0")
        folder = self.root / "proc" / str(number) / "fd"
        folder.mkdir()
        for place, file in enumerate(files):
            (folder / str(place)).symlink_to(file)

    def listen(self, port: int, inode: int = 77) -> None:
        """Let somebody wait for connections at a TCP port of loopback."""
        line = (
            f"   0: 0100007F:{port:04X} 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1000        0 {inode}"
        )
        self.write("/proc/net/tcp", f"  sl  local_address ...\n{line} 1 0\n")

    def configure(self, more: str = "", **changes: Any) -> None:
        """Write the configuration; `more` is added, `changes` go before what a healthy one has."""
        keys = {
            "port": f'"{PORT}"',
            "baud": "57600",
            "fps": "30",
            "width": "1280",
            "height": "720",
            "bus": "",
        } | changes
        calibration = self.config.with_name("camera.toml")
        if not calibration.exists():
            calibration.write_text(CALIBRATION, encoding="utf-8")
        self.config.write_text(
            f"[link]\nport = {keys['port']}\nbaud = {keys['baud']}\n[bus]\n{keys['bus']}\n"
            f'[record]\nfolder = "/var/lib/records"\n[[cameras]]\nsource = "{keys.get("source", "/dev/video0")}"\n'
            f'targets = ["{CONFIGS}/targets/nested.toml"]\nfps = {keys["fps"]}\nwidth = {keys["width"]}\n'
            f'height = {keys["height"]}\n{keys.get("calibration", f"""calibration = "{calibration}" """)}\n{more}\n',
            encoding="utf-8",
        )

    def tell(self, **values: Any) -> None:
        """Let a daemon run here that tells something."""
        before = {} if self.report is NO_DAEMON else self.report._asdict()
        self.report = report(**{**before, **values})

    def answers(self, **given: Any) -> None:
        """Give the machine other answers of the system."""
        self.machine = replace(self.machine, **given)

    def examined(self) -> Examined:
        """What the doctor sees."""
        if self.report is not NO_DAEMON:
            self.listen(7447)
        return examine(self.machine, self.config)

    def _run(self, words: Sequence[str]) -> CommandOutput:
        self.typed.append(tuple(words))
        return self.commands.get(" ".join(words), CommandOutput(127, ""))

    def _plug_in(self) -> None:
        """An FTDI adapter on USB bus 1, and a camera on bus 2."""
        self.write("/dev/ttyUSB0")
        self.write("/dev/video0")
        self.link(PORT, "/dev/ttyUSB0")
        adapter, eye = "/sys/devices/pci0/usb1/1-1", "/sys/devices/pci0/usb2/2-1"
        for device, vendor, bus, speed in ((adapter, "0403", "1", "12"), (eye, "0c45", "2", "480")):
            self.write(f"{device}/idVendor", vendor)
            self.write(f"{device}/busnum", bus)
            self.write(f"{device}/speed", speed)
            self.write(f"{device}/power/control", "on")
        self.write(f"{adapter}/1-1:1.0/ttyUSB0/latency_timer", "1\n")
        self.write(f"{eye}/2-1:1.0/uevent")
        self.write("/sys/class/video4linux/video0/index", "0\n")
        self.link("/sys/class/video4linux/video0/device", f"{eye}/2-1:1.0")
        self.link("/sys/class/tty/ttyUSB0/device", f"{adapter}/1-1:1.0/ttyUSB0")
        self.link("/sys/bus/usb/devices/1-1", adapter)

    def _boot(self) -> None:
        """Linux on two quiet cores, with a time service."""
        self.write("/proc/loadavg", "0.10 0.20 0.30 1/99 7\n")
        self.write("/proc/cmdline", "root=/dev/sda1 console=tty1\n")
        self.write("/proc/self/status", "Name:\tx\nCapEff:\t0000000000000000\nCpus_allowed_list:\t0-1\n")
        self.write("/proc/self/limits", "Max realtime priority     2                    2\n")
        self.write("/proc/meminfo", "MemTotal: 4000000 kB\nMemAvailable:    2000000 kB\n")
        self.write("/proc/net/tcp", "  sl  local_address ...\n")
        self.write("/proc/sys/kernel/sched_autogroup_enabled", "0\n")
        self.write("/proc/sys/kernel/sched_rt_runtime_us", "950000\n")
        for core in (0, 1):
            self.write(f"/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor", "performance\n")
            self.write(f"/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_driver", "cpufreq-dt\n")
        self.write("/sys/class/thermal/thermal_zone0/temp", "45000\n")
        self.write("/sys/class/thermal/thermal_zone0/type", "cpu-thermal\n")
        self.write("/sys/class/hwmon/hwmon1/in0_lcrit_alarm", "0\n")
        self.write("/var/lib/records/about")
        self.start(1, "systemd")
        self.start(300, "systemd-timesyn", "/lib/systemd/systemd-timesyncd")
        self.start(301, "systemd-journal")


def report(**given: Any) -> DaemonReport:
    """What a daemon at the usual endpoint tells; all is well where nothing else is given."""
    usual = {"endpoint": "tcp/127.0.0.1:7447", "daemons": 1, "clock": NOW, "between": (NOW - 1.0, NOW)}
    return DaemonReport(**{**usual, **given})
