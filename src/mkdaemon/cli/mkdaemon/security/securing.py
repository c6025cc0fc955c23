"""The commands: an authority and a first set, one more certificate, what there is."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final, Literal

from cyclopts import App, Parameter

from mkdaemon.cli.arguments import AsJson, Count
from mkdaemon.cli.mkdaemon.security.certificates import (
    Pair,
    describe_certificate,
    issue_certificate,
    load_authority,
    make_authority,
    read_certificate,
    tls_fields,
)
from mkdaemon.cli.mkdaemon.security.roles import DAEMON, ROLES, ROUTER, SERVERS, zenoh_file
from mkdaemon.cli.printing import json_line
from mkdaemon.cli.program import EXIT_FAILURE, EXIT_OK
from mkdaemon.cli.terminal import on_one_line
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import refuse_existing, save

RoleName = Literal["pilot", "observer", "recorder", "source", "daemon", "router"]
DAYS: Final = 825
"""How long a certificate counts [days]."""
HERE: Final = ("localhost", "127.0.0.1")
"""A daemon and a router are always reached at these."""
MAY: Final = {DAEMON: "listen, and be commanded", ROUTER: "join daemons and clients, and check every request"}
"""What those may that clients connect to."""

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")

app = App(
    name="security", help="Certificates and access rules: which clients of other machines may look, fly or record."
)


@app.command(name="new-ca")
def new_ca(
    folder: Path,
    *hosts: str,
    days: Count = DAYS,
    force: bool = False,
) -> None:
    """Make an authority, and a file each for a daemon, a pilot, an observer, a recorder and a source: all they need.

    Example: mkdaemon security new-ca security ground.example 192.168.7.1

    Args:
        folder: Where to write them; it is made, and it is yours alone.
        hosts: Names and addresses at which clients reach the daemon; localhost is always among them.
        days: How long the certificates count.
        force: Replace an existing authority: then every client needs a new file.

    Raises:
        ConfigError: an authority is there already, or a host is no name.
        MkError: a file cannot be written.
    """
    refuse_existing(folder / "ca.key", overwrite=force)
    now = datetime.now(UTC)
    authority = make_authority(now)
    roles = (DAEMON, *(role.name for role in ROLES))
    pairs = {
        role: issue_certificate(
            authority, role, role, now=now, days=days, hosts=(*HERE, *hosts) if role == DAEMON else ()
        )
        for role in roles
    }
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise MkError(f"{folder}: {error.strerror}") from error
    _save(folder / "ca.key", authority.key_pem, force=force)
    save(folder / "ca.pem", authority.certificate_pem, overwrite=force)
    for role, pair in pairs.items():
        _write_file(folder / f"{role}.json5", authority, pair, role, role, force=force)
    print("\n".join(_next_steps(folder, hosts)))


@app.command
def issue(
    name: str,
    *,
    role: RoleName = "pilot",
    ca: Path = Path("security"),
    host: tuple[str, ...] = (),
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    days: Count = DAYS,
    force: bool = False,
) -> None:
    """Issue one more certificate; no daemon needs a restart for it.

    Example: mkdaemon security issue alice --role observer --ca security

    Args:
        name: Whose it is, for `show`; what its holder may do is said by the role.
        role: What its holder may do; `daemon` is for one more aircraft, `router` for what joins several.
        ca: Folder of the authority.
        host: Name or address at which a daemon or a router is reached; may be given again.
        output: File to write; NAME.json5 beside the authority by default.
        days: How long it counts.
        force: Overwrite the file.

    Raises:
        ConfigError: there is no authority, the file is there already, or --host belongs to a client.
        MkError: the file cannot be written.
    """
    if host and role not in SERVERS:
        raise ConfigError(f"--host: only a daemon or a router is reached at a host, and the role is {role}")
    if _NAME.fullmatch(name) is None:
        raise ConfigError(f"{name!r}: a name has letters, digits, `.`, `_` and `-`, at most 64")
    authority = load_authority(ca)
    hosts = (*HERE, *host) if role in SERVERS else ()
    pair = issue_certificate(authority, role, name, now=datetime.now(UTC), days=days, hosts=hosts)
    path = output or ca / f"{name}.json5"
    _write_file(path, authority, pair, role, name, force=force)
    print(f"wrote {on_one_line(path)}: {name} is {role}; hand it over as a secret")


@app.command
def show(paths: tuple[Path, ...] = (Path("security"),), *, as_json: AsJson = False) -> int:
    """Show certificates: whose, for what, for which hosts, and until when. Exit code 1 where one has ended.

    Example: mkdaemon security show security

    Args:
        paths: Files, or folders of them.

    Raises:
        ConfigError: a file cannot be read, or no certificate is there.
    """
    now, ended, count = datetime.now(UTC), 0, 0
    for path in _files(paths):
        certificate = read_certificate(path)
        if certificate is None:
            continue
        count += 1
        found = describe_certificate(certificate)
        days = (found.until - now).total_seconds() / 86400
        ended += days < 0
        if as_json:
            print(json_line({"file": str(path), **found._asdict(), "days": round(days, 1)}))
            continue
        state = f"ENDED {found.until:%Y-%m-%d}" if days < 0 else f"until {found.until:%Y-%m-%d} ({days:.0f} days)"
        hosts = f" at {', '.join(found.hosts)}" if found.hosts else ""
        whose = f"{found.role} {found.name}".strip()
        print(on_one_line(f"{path}: {whose}{hosts}, {state}, SHA-256 {found.fingerprint[:16]}"))
    if not count:
        raise ConfigError(f"{', '.join(map(str, paths))}: no certificate; make some with `mkdaemon security new-ca`")
    return EXIT_FAILURE if ended else EXIT_OK


def _files(paths: Sequence[Path]) -> Iterator[Path]:
    """Files that may hold a certificate."""
    for path in paths:
        if path.is_dir():
            yield from sorted(found for found in path.iterdir() if found.suffix in (".pem", ".json5"))
        else:
            yield path


def _write_file(path: Path, authority: Pair, pair: Pair, role: str, name: str, *, force: bool) -> None:
    """Write the Zenoh configuration of a daemon or a client."""
    may = {each.name: each.may for each in ROLES}.get(role, MAY.get(role, ""))
    use = {DAEMON: "bus.zenoh_file", ROUTER: "zenohd --config"}.get(role, "MK_ZENOH_FILE")
    about = f"{name}, {role}: may {may}.\nUse: {use}. It holds a private key: keep it secret."
    fields = tls_fields(authority.certificate, pair, role)
    _save(path, zenoh_file(role, fields, about).encode(), force=force)


def _save(path: Path, content: bytes, *, force: bool) -> None:
    """Write a secret that other users can read at no moment."""
    with _private():
        save(path, content, overwrite=force)
    path.chmod(0o600)


@contextmanager
def _private() -> Iterator[None]:
    """Create files that other users cannot read, while the context lasts."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)


def _next_steps(folder: Path, hosts: Sequence[str]) -> Iterator[str]:
    """What to do with the files."""
    place = f"{on_one_line(folder)}"
    where = hosts[0] if hosts else HERE[0]
    yield f"wrote {place}: ca.key ca.pem {DAEMON}.json5 {' '.join(f'{role.name}.json5' for role in ROLES)}"
    yield f"keep {place}/ca.key off the network; give each machine its one file, as a secret"
    yield f'daemon: [bus] listen = ["tls/0.0.0.0:7447"] and zenoh_file = "{place}/{DAEMON}.json5"'
    yield f"client: MK_ZENOH_FILE={place}/pilot.json5 mkctl status --connect tls/{where}:7447"
    for role in ROLES:
        yield f"  {role.name}.json5 may {role.may}"
