"""Checks of the bus: where daemons listen, whether they answer, who can reach them, certificates, versions of Zenoh."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import zenoh

from mkdaemon.bus.exposure import open_endpoints
from mkdaemon.bus.session import session_config
from mkdaemon.cli.mkdaemon.doctor.check import CheckPart, Needs, Patient, Severity, Values
from mkdaemon.cli.mkdaemon.doctor.computer import release_of
from mkdaemon.cli.mkdaemon.doctor.daemonreport import client_endpoint
from mkdaemon.cli.mkdaemon.doctor.machine import Listener, Process
from mkdaemon.errors import ConfigError

BUS: Final = CheckPart("The bus")

WARNED: Final = 30
"""A certificate that ends within this time has to be replaced [days]."""
_DATE: Final = re.compile(r"notAfter=(.+)")
_TLS: Final = "transport/link/tls/{}"
_CERTIFICATES: Final = ("root_ca_certificate", "listen_certificate", "connect_certificate")
_KEYS: Final = ("listen_private_key", "connect_private_key")
_NAMING: Final = ("--config", "-c", "--vehicle", "--port", "-p")


def port_of(endpoint: str) -> int | None:
    """The TCP port of an endpoint; None where it has none."""
    number = re.split(r"[?#]", endpoint)[0].rpartition(":")[2]
    return int(number) if number.isdigit() and not endpoint.startswith("udp/") else None


def listener_at(patient: Patient, endpoint: str) -> Listener | None:
    """The listener at an endpoint of this machine; None if there is none."""
    port = port_of(endpoint)
    return next((found for found in patient.machine.listeners if port and found.port == port), None)


def owner_of(patient: Patient, listener: Listener) -> Process | None:
    """The program that listens; None where this user may not see it."""
    name = f"socket:[{listener.inode}]"
    return next((process for process in patient.machine.processes if name in process.files), None)


def _naming(process: Process) -> tuple[str, ...]:
    """Arguments that distinguish one daemon from another."""
    words = process.words[process.words.index("run") + 1 :]
    return tuple(f"{word} {words[place + 1]}" for place, word in enumerate(words[:-1]) if word in _NAMING) + tuple(
        word for word in words if word.partition("=")[0] in _NAMING and "=" in word
    )


def _zenoh_config(patient: Patient) -> zenoh.Config | None:
    """Configuration of the session; None if the file is wrong: another check reports that."""
    bus = patient.cfg.bus
    with suppress(ConfigError):
        return session_config("peer", listen=bus.listen, connect=bus.connect, zenoh_file=bus.zenoh_file)
    return None


def _named_files(patient: Patient, names: tuple[str, ...]) -> Iterator[Path]:
    """Files of TLS that the configuration of Zenoh names, each once."""
    config = _zenoh_config(patient) if patient.cfg.bus.zenoh_file is not None else None
    found = set()
    for name in names if config is not None else ():
        with suppress(zenoh.ZError):
            value = json.loads(config.get_json(_TLS.format(name)) if config is not None else "null")
            found |= {value} if isinstance(value, str) else set()
    yield from sorted(map(Path, found))


def _embedded_certificate(patient: Patient) -> float | None:
    """When the certificate in a file of `mkdaemon security` ends [s; Unix time]; None where there is none."""
    file = patient.cfg.bus.zenoh_file
    with suppress(ConfigError):  # it cannot be read, or the extra `security` is not installed
        from mkdaemon.cli.mkdaemon.security.certificates import read_certificate

        certificate = None if file is None else read_certificate(file)
        return None if certificate is None else certificate.not_valid_after_utc.timestamp()
    return None


def _expiry(end: float, now: float) -> str:
    """That a certificate ends soon, or has; empty where there is time."""
    days = (end - now) / 86400
    return "" if days >= WARNED else "has expired" if days < 0 else f"expires in {days:.0f} days"


@BUS("endpoint", Severity.ERROR)
def _taken(patient: Patient) -> Iterator[Values]:
    """bus.listen {endpoint} is taken by {holder}

    The daemon cannot listen there, and stops.

    End that program, or choose another endpoint in bus.listen.

    $ kill {number}
    """
    for endpoint in patient.cfg.bus.listen:
        listener = listener_at(patient, endpoint)
        owner = None if listener is None else owner_of(patient, listener)
        if owner is not None and not owner.is_ours:
            yield {"endpoint": endpoint, "holder": owner, "number": owner.number}


@BUS("endpoint-daemon", Severity.ERROR, Needs.CONFIG)
def _held(patient: Patient) -> Iterator[Values]:
    """bus.listen {endpoint} is used by {holder}, which does not serve {vehicle}

    It is the daemon of another aircraft, or a router. The daemon of {file} cannot listen there, and stops.

    Choose another endpoint in bus.listen; or, on the ground, end the other program.

    $ mkdaemon config explain bus.listen
    """
    # Endpoints of the file at which a daemon answers that does not speak for the vehicle of the file
    report = patient.report
    if patient.file is None or report.failure or report.daemons:
        return
    for endpoint in patient.cfg.bus.listen:
        listener = listener_at(patient, endpoint)
        if listener is not None and report.endpoint == client_endpoint(endpoint):
            holder = owner_of(patient, listener) or "a program of another user"
            yield {"endpoint": endpoint, "holder": holder, "vehicle": patient.cfg.vehicle.name, "file": patient.file}


@BUS("second-daemon", Severity.ERROR)
def _second(patient: Patient) -> Iterator[Values]:
    """two daemons of one configuration run: processes {first} and {second}

    Both answer for one vehicle, but only one has the port.

    End the second one.

    $ kill {second}
    """
    seen: dict[tuple[str, ...], Process] = {}
    for process in patient.machine.processes:
        if process.is_daemon:
            first = seen.setdefault(_naming(process), process)
            if first is not process:
                yield {"first": first.number, "second": process.number}


@BUS("vehicle-twice", Severity.ERROR, Needs.DAEMON)
def _twice(patient: Patient) -> Iterator[Values]:
    """{count} daemons at {endpoint} serve {vehicle}

    Each command reaches all of them: two aircraft could take off.

    Give each aircraft a different vehicle.name.

    $ mkdaemon config explain vehicle.name
    """
    report = patient.report
    if report.daemons > 1:
        yield {"count": report.daemons, "vehicle": patient.cfg.vehicle.name, "endpoint": report.endpoint}


@BUS("bus", Severity.ERROR, Needs.DAEMON)
def _silent(patient: Patient) -> Iterator[Values]:
    """no answer over the bus at {endpoint}: {failure}

    No client can reach the aircraft through this endpoint.

    Start the daemon or router; with TLS, set MK_ZENOH_FILE to a client's file; correct bus.connect.

    $ mkctl status --connect {endpoint}
    """
    if patient.report.failure:
        yield {"endpoint": patient.report.endpoint, "failure": patient.report.failure}


@BUS("zenoh-version", Severity.WARNING, Needs.DAEMON)
def _versions(patient: Patient) -> Iterator[Values]:
    """the Zenoh router is {router}, and the library here {ours}

    Different releases of Zenoh may lose messages or not connect.

    Install this release on the router's machine.

    $ pip install --upgrade eclipse-zenoh=={ours}
    """
    ours = patient.machine.installed_version("eclipse-zenoh") or ""
    for version in patient.report.routers:
        if release_of(version.lstrip("v"))[:2] != release_of(ours)[:2]:
            yield {"router": version, "ours": ours}


@BUS("open-bus", Severity.WARNING, Needs.CONFIG)
def _open(patient: Patient) -> Iterator[Values]:
    """{endpoints} lets every program in the network fly the aircraft

    bus.allow_open permits it.

    Listen on 127.0.0.1, or give each client a certificate.

    $ mkdaemon security new-ca --help
    """
    config = _zenoh_config(patient) if patient.cfg.bus.allow_open else None
    if config is not None and (reachable := open_endpoints(config)):
        yield {"endpoints": ", ".join(reachable)}


@BUS("certificate", Severity.WARNING, Needs.CONFIG)
def _certificates(patient: Patient) -> Iterator[Values]:
    """the certificate {file} {found}

    After that date no client can connect or reconnect; a flight in progress continues.

    Issue it again with `mkdaemon security`.

    $ mkdaemon security show
    """
    machine = patient.machine
    embedded = _embedded_certificate(patient)
    if embedded is not None and (found := _expiry(embedded, machine.wall())):
        yield {"file": patient.cfg.bus.zenoh_file, "found": found}
    for path in _named_files(patient, _CERTIFICATES):
        if not path.is_file():
            yield {"file": path, "found": "is not there"}
            continue
        output = _DATE.search(machine.run(["openssl", "x509", "-enddate", "-noout", "-in", str(path)]).out)
        if output is not None:
            end = datetime.strptime(output[1].strip(), "%b %d %H:%M:%S %Y %Z").replace(tzinfo=UTC).timestamp()
            if found := _expiry(end, machine.wall()):
                yield {"file": path, "found": found}


@BUS("private-key", Severity.WARNING, Needs.CONFIG, is_safe=True)
def _readable_keys(patient: Patient) -> Iterator[Values]:
    """every user of this machine can read the private key {file}

    Anyone who can read this key can impersonate its owner.

    Let only its owner read it.

    $ chmod o-rwx {file}
    """
    embedding = [patient.cfg.bus.zenoh_file] if _embedded_certificate(patient) is not None else []
    for path in filter(None, (*embedding, *_named_files(patient, _KEYS))):
        if path.is_file() and path.stat().st_mode & 0o004:
            yield {"file": path}
