"""Checks of the serial line: adapters, permissions, other users of a port, and causes of delay."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from mkdaemon.cli.mkdaemon.doctor.check import CheckPart, Needs, Patient, Severity, Values
from mkdaemon.config.reader import samples_folder
from mkdaemon.errors import ConfigError
from mkdaemon.link.ports.port import DEFAULT_BAUD, parse_address

SERIAL_LINE: Final = CheckPart("The serial line")

FTDI_DELAY_MS: Final = 2
"""Longest latency timer that is good enough [ms]; the chip's default of 16 delays every frame by up to that."""
ADAPTERS: Final = ("dev/ttyUSB*", "dev/ttyACM*")
DRIVERS: Final = {"0403": "ftdi_sio", "10c4": "cp210x", "1a86": "ch341", "067b": "pl2303"}
"""Kernel modules by the vendor of the adapter's chip; linux/drivers/usb/serial."""
RULES: Final = "60-mkdaemon.rules"
_RULE_FOLDERS: Final = ("etc/udev/rules.d", "run/udev/rules.d", "usr/local/lib/udev/rules.d", "usr/lib/udev/rules.d")


def wanted_port(patient: Patient) -> Path | None:
    """The device that the configuration names; None where it names none."""
    with suppress(ConfigError):
        address = parse_address(patient.cfg.link.port)
        return patient.machine.at(address.target) if address.scheme in ("serial", "pty") else None
    return None


def adapters(patient: Patient) -> list[Path]:
    """USB adapters that are plugged in."""
    return [port for pattern in ADAPTERS for port in patient.machine.find(pattern)]


def examined_ports(patient: Patient) -> list[Path]:
    """The device of the configuration, else every adapter; only what is there."""
    wanted = wanted_port(patient)
    return adapters(patient) if wanted is None else [wanted] * wanted.exists()


def _stable_names(patient: Patient) -> dict[Path, str]:
    """Names that survive replugging, by device."""
    links = patient.machine.find("dev/serial/by-id/*")
    return {link.resolve(): patient.machine.shown(link) for link in links}


def usb_device(device: Path) -> Path | None:
    """The USB device that a part of it in sysfs belongs to; None where it is no USB device."""
    place = device.resolve()
    return next((folder for folder in (place, *place.parents) if (folder / "idVendor").is_file()), None)


@SERIAL_LINE("no-adapter", Severity.WARNING)
def _without_adapter(patient: Patient) -> Iterator[Values]:
    """no USB serial adapter is plugged in, and no port is configured

    The daemon reaches an aircraft over one; the simulator needs none.

    Plug in the radio or the cable, or fly the simulator.

    $ mkdaemon demo
    """
    if not patient.cfg.link.port and not adapters(patient):
        yield {}


@SERIAL_LINE("port-missing", Severity.ERROR, Needs.CONFIG)
def _missing(patient: Patient) -> Iterator[Values]:
    """link.port {port} does not exist

    The daemon stops at its start, or waits for the port.

    Plug it in, or set link.port to a port of this machine: {near}.

    $ ls -l /dev/serial/by-id/
    """
    wanted = wanted_port(patient)
    if wanted is not None and not wanted.exists():
        near = [*_stable_names(patient).values()] or [patient.machine.shown(port) for port in adapters(patient)]
        yield {"port": patient.machine.shown(wanted), "near": ", ".join(near) or "nothing"}


@SERIAL_LINE("port-forbidden", Severity.ERROR)
def _forbidden(patient: Patient) -> Iterator[Values]:
    """{user} may not open {port}

    Only members of its group may open a serial port.

    Join the group, then log in again.

    $ sudo usermod -aG {group} {user}
    """
    machine = patient.machine
    for port in examined_ports(patient):
        if not machine.may_use(port):
            yield {"port": machine.shown(port), "user": machine.user, "group": machine.group_of(port)}


@SERIAL_LINE("port-busy", Severity.ERROR)
def _busy(patient: Patient) -> Iterator[Values]:
    """{port} is in use by {holder}

    Two programs on one line take each other's bytes.

    End that program.

    $ kill {number}
    """
    machine = patient.machine
    for port in examined_ports(patient):
        for holder in machine.holders(port):
            if not holder.is_ours:
                yield {"port": machine.shown(port), "holder": holder, "number": holder.number}


@SERIAL_LINE("port-console", Severity.ERROR)
def _console(patient: Patient) -> Iterator[Values]:
    """{port} is the system's console: {found}

    The board receives the system's messages, and a login prompt answers the board.

    Remove console= from the kernel's command line and the login from the port, then restart;
    docs/operations.md, UARTs.

    $ sudo systemctl disable --now serial-getty@{tty}
    """
    machine = patient.machine
    kernel = machine.read("/proc/cmdline").split()
    for port in examined_ports(patient):
        tty = port.resolve().name
        by_kernel = any(word.partition(",")[0] == f"console={tty}" for word in kernel)
        login = any(tty in process.words[1:] for process in machine.processes if "getty" in process.name)
        if by_kernel or login:
            found = "the kernel writes its messages to it" if by_kernel else "a login waits on it"
            yield {"port": machine.shown(port), "tty": tty, "found": found}


@SERIAL_LINE("port-name", Severity.ADVICE, Needs.CONFIG)
def _unstable(patient: Patient) -> Iterator[Values]:
    """link.port {port} is not a stable name

    After replugging, or with a second adapter, it can be another device.

    Use the name below /dev/serial/by-id.

    $ sed -i {edit} {file}
    """
    wanted = wanted_port(patient)
    stable = None if wanted is None else _stable_names(patient).get(wanted)
    if wanted is not None and stable is not None and patient.file is not None:
        yield {
            "port": patient.machine.shown(wanted),
            "edit": f"s|{patient.machine.shown(wanted)}|{stable}|",
            "file": patient.file,
        }


@SERIAL_LINE("ftdi-latency", Severity.WARNING, is_safe=True)
def _slow_timer(patient: Patient) -> Iterator[Values]:
    """{port} delays received bytes by {delay} ms (FTDI latency timer)

    Every answer of the board is late by up to this time.

    Set 1 ms; configs/udev/60-mkdaemon.rules does so whenever it is plugged in.

    $ echo 1 | sudo tee {timer}
    """
    machine = patient.machine
    for port in examined_ports(patient):
        timer = machine.at(f"/sys/class/tty/{port.resolve().name}/device/latency_timer")
        text = machine.read(timer)
        if text.isdigit() and int(text) > FTDI_DELAY_MS:
            yield {"port": machine.shown(port), "delay": text, "timer": timer}


@SERIAL_LINE("usb-sleep", Severity.WARNING, is_safe=True)
def _asleep(patient: Patient) -> Iterator[Values]:
    """the system may suspend the adapter of {port} to save power

    It loses bytes that arrive while it wakes up.

    Switch its power saving off, also in TLP or powertop.

    $ echo on | sudo tee {control}
    """
    machine = patient.machine
    for port in examined_ports(patient):
        device = usb_device(machine.at(f"/sys/class/tty/{port.resolve().name}/device"))
        if device is not None and machine.read(device / "power" / "control") == "auto":
            yield {"port": machine.shown(port), "control": device / "power" / "control"}


@SERIAL_LINE("adapter-driver", Severity.ERROR)
def _without_driver(patient: Patient) -> Iterator[Values]:
    """{adapter} is plugged in, but has no serial port

    The kernel has no driver for its chip, or another program has taken it.

    Load the driver; if nothing changes, see brltty below, and the end of `sudo dmesg`.

    $ sudo modprobe {driver}
    """
    machine = patient.machine
    for vendor in machine.find("sys/bus/usb/devices/*/idVendor"):
        driver = DRIVERS.get(machine.read(vendor))
        device = vendor.parent
        if driver is not None and not [*device.glob("*/ttyUSB*"), *device.glob("*/tty/ttyACM*")]:
            called = machine.read(device / "product") or f"USB device {device.name}"
            yield {"adapter": called, "driver": driver}


@SERIAL_LINE("brltty", Severity.ERROR)
def _brltty(patient: Patient) -> Iterator[Values]:
    """brltty takes serial adapters for braille displays: {found}

    A braille terminal takes the adapter away, and /dev/ttyUSB0 disappears when it is plugged in.

    If braille is not needed, remove it.

    $ sudo apt-get remove brltty
    """
    machine = patient.machine
    process = machine.running("brltty")
    if process is not None:
        yield {"found": f"{process} runs"}
    elif rules := [rule for folder in _RULE_FOLDERS for rule in machine.find(f"{folder}/*brltty*.rules")]:
        yield {"found": f"{machine.shown(rules[0])} starts it"}


@SERIAL_LINE("modem-manager", Severity.WARNING)
def _modem_manager(patient: Patient) -> Iterator[Values]:
    """ModemManager runs, and no udev rule keeps it off serial adapters

    It sends AT commands to every new port, also to the aircraft.

    Install the udev rules.

    $ sudo install -m 644 {rules} /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm trigger
    --action=add --subsystem-match=tty
    """
    machine = patient.machine
    has_rules = any(machine.at(f"/{folder}/{RULES}").exists() for folder in _RULE_FOLDERS)
    if machine.running("ModemManager") is not None and not has_rules:
        yield {"rules": samples_folder().resolve() / "udev" / RULES}


@SERIAL_LINE("baud", Severity.WARNING, Needs.CONFIG)
def _baud(patient: Patient) -> Iterator[Values]:
    """link.baud is {baud}

    MikroKopter boards use 57600 baud. Only a radio whose near end has another rate needs another value.

    Set it to 57600.

    $ sed -i {edit} {file}
    """
    baud = patient.cfg.link.baud
    if baud != DEFAULT_BAUD and wanted_port(patient) is not None and patient.file is not None:
        edit = f"s/^baud *= *{baud}/baud = {DEFAULT_BAUD}/"
        yield {"baud": baud, "edit": edit, "file": patient.file}
