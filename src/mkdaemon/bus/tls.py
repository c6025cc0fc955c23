"""Finds why a TLS connection fails: Zenoh only reports that there is none."""

from __future__ import annotations

import base64
import errno
import json
import re
import socket
import ssl
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import zenoh

from mkdaemon.files import save

PATIENCE: Final = 2.0
"""Longest time for the handshake, and for the daemon to refuse a certificate after it [s]."""
_ENDPOINT: Final = re.compile(r"tls/(?P<host>\[[^\]]+\]|[^:/]+):(?P<port>\d+)")
_FIX: Final = "show a certificate of the daemon's own authority (docs/security.md)"
_EMBEDDED: Final = ("root_ca_certificate", "connect_certificate", "connect_private_key")
"""May stand in the file itself, in base64."""


def explain_tls_failure(config: zenoh.Config) -> str | None:
    """Shake hands as Zenoh would, and say what the other side, or this one, has against it.

    Args:
        config: of the session that was not opened.

    Returns:
        One sentence; None where TLS is not what keeps them apart.
    """
    for endpoint in json.loads(config.get_json("connect/endpoints")):
        place = _ENDPOINT.match(endpoint)
        if place is not None:
            return _try(place["host"].strip("[]"), int(place["port"]), _settings(config))
    return None


def _settings(config: zenoh.Config) -> dict[str, str | bool | None]:
    settings: dict[str, str | bool | None] = json.loads(config.get_json("transport/link/tls"))
    for name in _EMBEDDED:  # Zenoh shows them one by one alone: they may be secrets
        content: str | None = json.loads(config.get_json(f"transport/link/tls/{name}_base64"))
        if content:
            settings[f"{name}_base64"] = content
    return settings


def _context(settings: dict[str, str | bool | None]) -> ssl.SSLContext:
    """What this client trusts, and what it shows.

    Raises:
        OSError: a certificate or a key cannot be used.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = settings["verify_name_on_connect"] is not False
    with TemporaryDirectory() as folder:  # the module takes certificates and keys out of files alone
        files = {name: _file_of(settings, name, Path(folder)) for name in _EMBEDDED}
        if files["root_ca_certificate"]:
            context.load_verify_locations(files["root_ca_certificate"])
        if files["connect_certificate"]:
            context.load_cert_chain(files["connect_certificate"], files["connect_private_key"])
    return context


def _file_of(settings: dict[str, str | bool | None], name: str, folder: Path) -> str | None:
    """The file of a certificate or a key; where it stands in the configuration itself, one in a folder of this user.

    Raises:
        OSError: it is not base64.
    """
    content = settings.get(f"{name}_base64")
    if not content:
        return str(settings[name]) if settings[name] else None
    try:
        raw = base64.b64decode(str(content), validate=True)
    except ValueError as error:
        raise OSError(errno.EINVAL, f"{name}_base64 is not base64") from error
    path = folder / name
    save(path, raw)
    return str(path)


def _try(host: str, port: int, settings: dict[str, str | bool | None]) -> str | None:
    try:
        context = _context(settings)
    except OSError as error:
        return f"the certificates of this client cannot be used: {error.strerror or error}"
    try:
        with (
            socket.create_connection((host, port), PATIENCE) as plain,
            context.wrap_socket(plain, server_hostname=host) as secured,
        ):
            secured.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"this client does not trust the certificate at {host}:{port}: {error.verify_message}; {_FIX}"
    except ssl.SSLError as error:
        reason = (error.reason or "handshake failed").lower().replace("_", " ")
        return f"{host}:{port} refuses this client's certificate ({reason}); {_FIX}"
    except OSError:
        return None
    return None
