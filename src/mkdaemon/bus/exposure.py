"""Exposure of the bus: which endpoints the network reaches, and whether they authenticate clients."""

from __future__ import annotations

import ipaddress
import json
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, Final

import zenoh

from mkdaemon.errors import ConfigError

_NETWORK: Final = frozenset({"tcp", "udp", "tls", "quic", "ws"})
_CERTIFIED: Final = frozenset({"tls", "quic"})
"""Protocols under which a client can be asked for a certificate."""


def is_local(endpoint: str) -> bool:
    """Whether only programs on this machine reach a Zenoh endpoint: loopback, or no network at all."""
    protocol, _, address = endpoint.partition("/")
    host = address.partition("?")[0].partition("#")[0].rpartition(":")[0].strip("[]")
    if protocol not in _NETWORK or host == "localhost":
        return True
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return False


def open_endpoints(config: zenoh.Config) -> tuple[str, ...]:
    """Endpoints of a session that the network reaches and that accept unknown clients.

    Closed are those under TLS with client certificates (`enable_mtls`), and all of them where users have passwords
    (`transport/auth/usrpwd/dictionary_file`).
    """
    if _read(config, "transport/auth/usrpwd/dictionary_file"):
        return ()
    asks_certificate = _read(config, "transport/link/tls/enable_mtls") is True
    return tuple(
        endpoint
        for endpoint in _listening(_read(config, "listen/endpoints"))
        if not is_local(endpoint) and not (asks_certificate and endpoint.partition("/")[0] in _CERTIFIED)
    )


def check_exposure(config: zenoh.Config, *, allow_open: bool) -> tuple[str, ...]:
    """Refuse to listen if every program in the network could fly, unless that is allowed.

    Returns:
        Endpoints that are open.

    Raises:
        ConfigError: there are such, and they are not allowed.
    """
    found = open_endpoints(config)
    if found and not allow_open:
        msg = (
            f"bus.listen {', '.join(found)}: every program in the network could fly the aircraft. Listen on 127.0.0.1, "
            "set up client certificates (mkdaemon security), or set bus.allow_open = true if all its users may"
        )
        raise ConfigError(msg)
    return found


def _read(config: zenoh.Config, key: str) -> Any:
    """A value of a Zenoh configuration; None where there is none."""
    with suppress(zenoh.ZError):
        return json.loads(config.get_json(key))
    return None


def _listening(endpoints: Any) -> Iterable[str]:
    """Endpoints of a peer, whether there is one list or one for each mode."""
    return (endpoints.get("peer", ()) if isinstance(endpoints, dict) else endpoints) or ()
