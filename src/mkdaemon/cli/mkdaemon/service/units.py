"""The units of systemd, made from one table: what each starts, what it may do, and what all of them have in common.

The guard has none of its own: the daemon starts it and hands it the open port, and `KillMode=process` lets it outlive
the daemon until the aircraft is released.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

MARK: Final = "# Written by `mkdaemon install-service`; changes belong into `systemctl edit`."
"""First line of every unit: what does not begin so is the user's own."""
SAMPLE: Final = Path("/opt/mkdaemon/.venv/bin")
"""Where the programs of the samples in configs/systemd/ are."""
SETTINGS: Final = Path("/etc/mkdaemon")

_SANDBOX: Final = """\
DevicePolicy=closed
{devices}ProtectSystem=strict
ProtectHome=yes
PrivateTmp=yes
PrivateMounts=yes
{private}ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
ProtectProc=invisible
NoNewPrivileges=yes
CapabilityBoundingSet=
LockPersonality=yes
MemoryDenyWriteExecute=yes
{priority}RestrictSUIDSGID=yes
RestrictNamespaces=yes
# Zenoh lists network interfaces over netlink.
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
SystemCallArchitectures=native
SystemCallFilter=@system-service
UMask=0077
"""
_DEVICES: Final = """\
# Every serial line: USB adapters (ttyUSB, ttyACM) and UARTs of the board (ttyAMA, ttyS, ttyTHS); group dialout decides.
DeviceAllow=char-tty[A-Z]* rw
DeviceAllow=char-video4linux rw
"""
_PRIORITY: Final = """\
# The event loop runs at the lowest real-time priority, so that a setpoint never waits for the camera; the guard above.
LimitRTPRIO=2
LimitNICE=-10
"""
_FLIES: Final = """\
Type=notify
ExecStart={programs}/mkdaemon run --config {settings}/{file}.toml{options}
# Reads the file again; the log says what needs a restart.
ExecReload=/bin/kill -USR1 $MAINPID
EnvironmentFile=-{settings}/{file}.env
Restart=on-failure
RestartSec=1
# A configuration error does not heal by itself.
RestartPreventExitStatus=2
WatchdogSec=2
# Only the daemon is stopped: the guard ends by itself, after the aircraft is released.
KillMode=process
TimeoutStopSec=5
DynamicUser=yes
SupplementaryGroups=dialout video
StateDirectory=mkdaemon{folder}
# The Unix socket of `mkctl release`; bus.local_group says who may use it.
RuntimeDirectory=mkdaemon{folder}
"""
_CLIENT: Final = """\
Restart=on-failure
RestartSec=1
# A mistake in the options does not heal by itself.
RestartPreventExitStatus=2
"""
_RECORDER: Final = (
    """\
# MK_CONNECT and MK_ZENOH_FILE (TLS), and one --also for each further daemon as OPTIONS, stand in this file; without it,
# the daemon of this machine is recorded.
EnvironmentFile=-{settings}/recorder.env
ExecStart={programs}/mkctl log record --folder /var/lib/mkdaemon-recorder --delete-oldest $OPTIONS
"""
    + _CLIENT
    + """\
# What waits is written before it ends.
TimeoutStopSec=15
DynamicUser=yes
StateDirectory=mkdaemon-recorder
"""
)
_GATEWAY: Final = (
    """\
# The instance names the gateway: mkdaemon-gateway@mavlink, @ros2, @foxglove. MK_VEHICLE, MK_CONNECT and MK_ZENOH_FILE,
# and the options of the gateway as OPTIONS, stand in this file; without it, the daemon of this machine is meant.
EnvironmentFile=-{settings}/gateway-%i.env
ExecStart={programs}/mkdaemon gateway %i $OPTIONS
"""
    + _CLIENT
    + """\
# The lease is given back before it ends.
TimeoutStopSec=5
DynamicUser=yes
StateDirectory=mkdaemon-gateway-%i
"""
)


class Unit(NamedTuple):
    """One unit.

    Attributes:
        name: of its file.
        about: what it is.
        page: where it is described, in docs/.
        service: what stands in `[Service]` before the sandbox; `{programs}` is the folder of the programs.
        flies: it opens serial lines and cameras, and goes before other programs.
        fields: what else stands in braces.
    """

    name: str
    about: str
    page: str
    service: str
    flies: bool = False
    fields: Mapping[str, str] = {}


UNITS: Final = (
    Unit(
        "mkdaemon.service",
        "MikroKopter daemon",
        "operations.md",
        _FLIES,
        flies=True,
        fields={"file": "vehicle", "options": "", "folder": ""},
    ),
    Unit(
        "mkdaemon@.service",
        "MikroKopter daemon of %i",
        "operations.md",
        _FLIES,
        flies=True,
        fields={"file": "%i", "options": " --vehicle %i", "folder": "/%i"},
    ),
    Unit("mkdaemon-recorder.service", "MikroKopter ground recorder", "recording.md", _RECORDER),
    Unit("mkdaemon-gateway@.service", "MikroKopter gateway %i", "operations.md", _GATEWAY),
)
"""Every unit."""


def unit_text(unit: Unit, programs: Path = SAMPLE) -> str:
    """What stands in the file of a unit.

    Args:
        unit: which one.
        programs: folder of `mkdaemon` and `mkctl`.
    """
    return "\n".join(_lines(unit, programs))


def _lines(unit: Unit, programs: Path) -> Iterator[str]:
    root = programs.parent.parent
    yield MARK
    yield "[Unit]"
    yield f"Description={unit.about}"
    yield f"Documentation=file:{root}/docs/{unit.page}"
    yield "After=network.target"
    if unit.flies:
        yield "# Without it systemd gives up after five starts in ten seconds, and nobody releases the aircraft."
        yield "StartLimitIntervalSec=0"
    yield ""
    yield "[Service]"
    sandbox = _SANDBOX.format(
        devices=_DEVICES if unit.flies else "",
        private="" if unit.flies else "PrivateDevices=yes\n",
        priority=_PRIORITY if unit.flies else "RestrictRealtime=yes\n",
    )
    yield unit.service.format(programs=programs, settings=SETTINGS, **unit.fields) + sandbox
    yield "[Install]"
    yield "WantedBy=multi-user.target"
    yield ""
