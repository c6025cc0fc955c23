"""Why a TLS connection does not come about: Zenoh only says that there is none."""

from __future__ import annotations

import json
import re
import socket
import ssl
from typing import Final

import zenoh

PATIENCE: Final = 2.0
"""Longest time for the handshake, and for the daemon to refuse a certificate after it [s]."""
_ENDPOINT: Final = re.compile(r"tls/(?P<host>\[[^\]]+\]|[^:/]+):(?P<port>\d+)")
_FIX: Final = "show a certificate of the daemon's own authority (configs/zenoh/README.md)"


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
    return settings


def _try(host: str, port: int, settings: dict[str, str | bool | None]) -> str | None:
    try:
        context = ssl.create_default_context(cafile=str(settings["root_ca_certificate"]))
        context.check_hostname = settings["verify_name_on_connect"] is not False
        if settings["connect_certificate"]:
            context.load_cert_chain(str(settings["connect_certificate"]), str(settings["connect_private_key"]))
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
