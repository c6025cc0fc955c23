"""Checks of the computer: processor, priorities, memory, heat, disk, clock, installed packages."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import Final

from mkdaemon.cli.mkdaemon.doctor.check import CheckPart, Needs, Patient, Severity, Typed, Values
from mkdaemon.cli.mkdaemon.service.units import MARK, unit_text
from mkdaemon.cli.mkdaemon.service.units import UNITS as SERVICE_UNITS
from mkdaemon.daemon.priority import CORES
from mkdaemon.daemon.procedures import state_folder
from mkdaemon.telemetry.preflight import LEAST_DISK

COMPUTER: Final = CheckPart("The computer")

BUSY: Final = 0.7
"""Load a core above which the machine counts as busy."""
LEAST_MEMORY_MB: Final = 250
"""The daemon with a camera takes 200 MB [MB]; docs/lab."""
HOT: Final = 80.0
"""From here on small computers slow their processor down [degree Celsius]; Raspberry Pi documentation, "Frequency
management"."""
STEADY: Final = frozenset({"performance", "schedutil"})
"""CPU governors that are fast when they have to be."""
HARDWARE_PACED: Final = frozenset({"intel_pstate", "amd-pstate-epp"})
"""Drivers under which the processor chooses its clock itself, whatever the governor is called."""
NICE_RIGHT: Final = 1 << 23
"""CAP_SYS_NICE; linux/capability.h."""
TIME_SERVICES: Final = ("systemd-timesyn", "chronyd", "ntpd", "ntpd-rs", "ntp-daemon", "openntpd")
"""Names of processes, as long as the kernel keeps them."""
SKEW: Final = 0.2
"""Difference of two clocks from which stamps mislead [s]; docs/frames.md."""
UNITS: Final = "etc/systemd/system/mkdaemon*.service"
_STARTS: Final = re.compile(r"(?m)^ExecStart=(\S+)/mk(?:daemon|ctl) ")
_KERNEL: Final = "/proc/sys/kernel"


def _cores(patient: Patient) -> int:
    """Cores that this program may use; proc(5), status."""
    found = re.search(r"(?m)^Cpus_allowed_list:\s*(\S+)", patient.machine.read("/proc/self/status"))
    count = 0
    for part in found[1].split(",") if found else ():
        first, _, last = part.partition("-")
        count += int(last or first) - int(first) + 1
    return count


def _folders(patient: Patient) -> list[Path]:
    """Where the daemon writes: its notes, and recordings."""
    record, state = patient.cfg.record, state_folder(patient.cfg.vehicle)
    recordings = record.folder or state / "recordings"
    return [patient.machine.at(str(folder)) for folder in ((state, recordings) if record.enabled else (state,))]


def _existing(folder: Path) -> Path:
    """A folder, or the nearest one above it that is there."""
    return next(place for place in (folder, *folder.parents) if place.is_dir())


def _disk(patient: Patient, least: float, enough: float) -> Iterator[Values]:
    machine, folder = patient.machine, _folders(patient)[-1]
    free = machine.free_bytes(_existing(folder.absolute()))
    if patient.cfg.record.enabled and free is not None and least <= free < enough:
        shown = machine.shown(folder)
        yield {"folder": shown, "free": int(free / 1e6), "kept": patient.cfg.record.free_mb}


def _fits(version: str, bound: str) -> bool:
    """Whether a version is within a bound like `>=1.7.2` or `<2`."""
    have, need = release_of(version), release_of(bound.lstrip("<>="))
    return have < need if bound.startswith("<") else have >= need


def release_of(version: str) -> tuple[int, ...]:
    """The numbers of a version."""
    return tuple(int(number) for number in re.findall(r"\d+", version.partition("-")[0].partition("+")[0]))


@COMPUTER("packages", Severity.ERROR)
def _packages(patient: Patient) -> Iterator[Values]:
    """package {package} is {found}, and {wanted} is needed

    mkdaemon was tested only with versions within these bounds.

    Install a version within the bounds into mkdaemon's environment.

    $ pip install {spec}
    """
    machine = patient.machine
    try:
        lines = requires("mkdaemon") or []
    except PackageNotFoundError:  # run from a source tree that is not installed
        return
    for line in lines:
        if "extra ==" in line or "sys_platform" in line:
            continue
        name = re.split(r"[<>=!~; ]", line)[0]
        wanted = line.partition(";")[0].removeprefix(name).strip()
        found = machine.installed_version(name)
        if found is None or not all(_fits(found, bound) for bound in filter(None, wanted.split(","))):
            yield {"package": name, "found": found or "missing", "wanted": wanted, "spec": f"{name}{wanted}"}


@COMPUTER("load", Severity.WARNING)
def _load(patient: Patient) -> Iterator[Values]:
    """the load is {load} on {cores}

    Other programs delay the control loop, and with it stick frames.

    Find these programs, and end them before a flight.

    $ top -o %CPU
    """
    words, cores = patient.machine.read("/proc/loadavg").split(), _cores(patient)
    if words and cores and float(words[0]) > BUSY * cores:
        yield {"load": words[0], "cores": "1 core" if cores == 1 else f"{cores} cores"}


@COMPUTER("one-core", Severity.WARNING, Needs.CONFIG)
def _few_cores(patient: Patient) -> Iterator[Values]:
    """a camera is configured, but there is only one core

    The search for tags in an image delays the control loop.

    Use a computer with two cores or more.
    """
    if patient.cfg.cameras and 0 < _cores(patient) < CORES:
        yield {}


@COMPUTER("governor", Severity.WARNING, is_safe=True)
def _governor(patient: Patient) -> Iterator[Values]:
    """the CPU governor of {cores} is {governor}

    It raises the clock only under load, so the first frames and images after a pause are late.

    Use the governor performance.

    $ echo performance | sudo tee {files}
    """
    machine, slow = patient.machine, []
    for core in machine.find("sys/devices/system/cpu/cpu[0-9]*/cpufreq"):
        governor, driver = machine.read(core / "scaling_governor"), machine.read(core / "scaling_driver")
        if governor and governor not in STEADY and driver not in HARDWARE_PACED:
            slow.append((core.parent.name, governor, str(core / "scaling_governor")))
    if slow:
        cores, governors, files = zip(*slow, strict=True)
        yield {"cores": ", ".join(cores), "governor": governors[0], "files": Typed(shlex.join(files))}


@COMPUTER("real-time", Severity.WARNING)
def _ordinary_priority(patient: Patient) -> Iterator[Values]:
    """{user} may not use real-time priority

    Without it, a busy program delays the control loop and the guard. The systemd service has this right.

    Grant the right, then log in again.

    $ printf {lines} | sudo tee /etc/security/limits.d/60-mkdaemon.conf
    """
    machine = patient.machine
    rights = re.search(r"(?m)^CapEff:\s*([0-9a-f]+)", machine.read("/proc/self/status"))
    limit = re.search(r"(?m)^Max realtime priority\s+(\d+|unlimited)", machine.read("/proc/self/limits"))
    is_service = bool(machine.find(UNITS))
    if limit is not None and limit[1] == "0" and not (rights and int(rights[1], 16) & NICE_RIGHT) and not is_service:
        lines = rf"{machine.user} - rtprio 2\n{machine.user} - nice -10\n"
        yield {"user": machine.user, "lines": lines}


@COMPUTER("autogroup", Severity.ADVICE, is_safe=True)
def _grouped(patient: Patient) -> Iterator[Values]:
    """the kernel divides the processor by session (autogroup)

    A busy terminal gets as much time as the daemon; it delayed received bytes by 0.2 to 0.8 s.

    Switch it off; the same setting in /etc/sysctl.d/60-mkdaemon.conf keeps it off.

    $ sudo sysctl -w kernel.sched_autogroup_enabled=0
    """
    if patient.machine.read(f"{_KERNEL}/sched_autogroup_enabled") == "1":
        yield {}


@COMPUTER("real-time-bound", Severity.WARNING, is_safe=True)
def _unbounded(patient: Patient) -> Iterator[Values]:
    """real-time programs have no limit

    They may use 100 % of a core: one that hangs blocks the shell and the watchdog.

    Leave 5 % to ordinary programs, the kernel's default.

    $ sudo sysctl -w kernel.sched_rt_runtime_us=950000
    """
    if patient.machine.read(f"{_KERNEL}/sched_rt_runtime_us") == "-1":
        yield {}


@COMPUTER("memory", Severity.WARNING)
def _memory(patient: Patient) -> Iterator[Values]:
    """{free} MB of memory are free, less than 250

    Without free memory the system stops the daemon for seconds, or kills it.

    Find the programs that use it, and end them.

    $ ps -e -o rss,pid,comm --sort=-rss | head
    """
    found = re.search(r"(?m)^MemAvailable:\s+(\d+) kB", patient.machine.read("/proc/meminfo"))
    if found is not None and int(found[1]) / 1000 < LEAST_MEMORY_MB:
        yield {"free": int(found[1]) // 1000}


@COMPUTER("heat", Severity.WARNING)
def _hot(patient: Patient) -> Iterator[Values]:
    """{sensor} is at {degrees} degrees Celsius

    A hot processor slows down, and images come late.

    Cool it, then check again.

    $ cat {file}
    """
    machine = patient.machine
    for zone in machine.find("sys/class/thermal/thermal_zone*/temp"):
        text = machine.read(zone)
        if text.isdigit() and int(text) / 1000 >= HOT:
            kind = machine.read(zone.parent / "type") or zone.parent.name
            yield {"sensor": kind, "degrees": int(text) // 1000, "file": machine.shown(zone)}


@COMPUTER("voltage", Severity.ERROR)
def _low_voltage(patient: Patient) -> Iterator[Values]:
    """the computer's supply voltage is too low

    The computer slows down, loses USB devices or restarts in flight.

    Use a regulator that gives 5 V under load, and a short, thick cable.

    $ cat {file}
    """
    machine = patient.machine
    for alarm in machine.find("sys/class/hwmon/hwmon*/in0_lcrit_alarm"):
        if machine.read(alarm) == "1":
            yield {"file": machine.shown(alarm)}


@COMPUTER("disk-full", Severity.ERROR)
def _disk_full(patient: Patient) -> Iterator[Values]:
    """{free} MB are free in {folder}

    The daemon cannot record, and refuses flights against a target.

    Find the largest folders, and delete files that you do not need.

    $ du -xh {folder} | sort -h | tail
    """
    return _disk(patient, 0.0, LEAST_DISK)


@COMPUTER("disk-short", Severity.WARNING)
def _disk_short(patient: Patient) -> Iterator[Values]:
    """{free} MB are free in {folder}, and record.free_mb reserves {kept}

    The daemon deletes old recordings, or does not record.

    Make room, or set record.free_mb lower.

    $ du -xh {folder} | sort -h | tail
    """
    return _disk(patient, LEAST_DISK, patient.cfg.record.free_mb * 1e6)


@COMPUTER("folder", Severity.ERROR)
def _unwritable(patient: Patient) -> Iterator[Values]:
    """{user} may not write in {folder}

    The daemon writes its recordings there, and the state from which it restores an aircraft after a crash.

    Change its owner, or set vehicle.state_folder and record.folder.

    $ sudo install -d -o {user} {folder}
    """
    machine = patient.machine
    for folder in _folders(patient):
        place = _existing(folder.absolute())
        if not machine.may_use(place) and not machine.find(UNITS):
            yield {"folder": machine.shown(folder), "user": machine.user}


@COMPUTER("no-time-service", Severity.WARNING, is_safe=True)
def _no_time_service(patient: Patient) -> Iterator[Values]:
    """the clock follows no time server, and no time service runs

    Time stamps of two machines cannot be compared.

    Enable the system's time service, or install chrony.

    $ sudo timedatectl set-ntp true
    """
    machine = patient.machine
    if machine.follows_server() is False and machine.running(*TIME_SERVICES) is None:
        yield {}


@COMPUTER("clock-unset", Severity.WARNING)
def _clock_behind(patient: Patient) -> Iterator[Values]:
    """the clock is {days} days before the installation of this program

    A computer without a battery for its clock starts in the past: recordings get wrong names, and certificates
    are not valid yet.

    Enable a time service, or set the clock: sudo timedatectl set-time 'YYYY-MM-DD HH:MM'.

    $ sudo timedatectl set-ntp true
    """
    machine = patient.machine
    behind = machine.installed_at - machine.wall()
    if behind > 0:
        yield {"days": f"{behind / 86400:.1f}"}


@COMPUTER("clock-free", Severity.WARNING)
def _not_followed(patient: Patient) -> Iterator[Values]:
    """{service} runs, and the clock does not follow a time server yet

    It reaches no server, or has just started.

    Check which servers it uses and whether they answer.

    $ {show}
    """
    machine = patient.machine
    service = machine.running(*TIME_SERVICES)
    if machine.follows_server() is False and service is not None:
        show = Typed("chronyc sources" if service.name == "chronyd" else "timedatectl timesync-status")
        yield {"service": service, "show": show}


@COMPUTER("clock-skew", Severity.WARNING, Needs.DAEMON)
def _skew(patient: Patient) -> Iterator[Values]:
    """the daemon's clock is {skew} s {way} this machine's

    Wrong results: ages of values, recordings of two machines, images from another machine.

    Synchronise both with a time server.

    $ sudo timedatectl set-ntp true
    """
    clock = patient.report.clock
    if clock is not None:
        asked, answered = patient.report.between  # it answered between the two
        skew = max(clock - answered, 0.0) + min(clock - asked, 0.0)
        if abs(skew) > SKEW:
            yield {"skew": f"{abs(skew):.1f}", "way": "ahead of" if skew > 0 else "behind"}


@COMPUTER("service-failed", Severity.ERROR)
def _failed_service(patient: Patient) -> Iterator[Values]:
    """the service {service} has failed

    No daemon controls the aircraft.

    The end of its log shows the cause.

    $ journalctl -u {service} -n 20 --no-pager
    """
    machine = patient.machine
    if not machine.find(UNITS):
        return
    listed = machine.run(["systemctl", "list-units", "--failed", "--plain", "--no-legend", "mkdaemon*"]).out
    for line in filter(None, listed.splitlines()):
        yield {"service": line.split()[0]}


@COMPUTER("service-old", Severity.WARNING)
def _old_units(patient: Patient) -> Iterator[Values]:
    """{file} is of another release than this program

    It may use options that no longer exist, or lack rights that the daemon needs.

    Write it again; then, on the ground, restart the service.

    $ sudo {programs}/mkdaemon install-service --write
    """
    for place in patient.machine.find(UNITS):
        text = patient.machine.read(place)
        started = _STARTS.search(text)
        if place.name in SERVICE_UNITS and started is not None:
            wanted = unit_text(place.name, Path(started[1]))
            if text != wanted.strip() and text.startswith(MARK):
                yield {"file": patient.machine.shown(place), "programs": started[1]}
