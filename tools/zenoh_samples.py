"""The samples of configs/zenoh/: TLS and access rules with certificates of an authority of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mkdaemon.cli.mkdaemon.security.roles import DAEMON, zenoh_file

FOLDER: Final = "/etc/mkdaemon/certificates"
_ABOUT: Final = """\
Made by `python -m tools.docs`. `mkdaemon security new-ca` makes such a file with certificates in it: docs/security.md.
With an authority of your own: certificates with the common names daemon, pilot, observer, recorder and source.
"""


def daemon(_root: Path) -> str:
    """Return the configuration of a daemon."""
    return zenoh_file(DAEMON, _files("daemon", "listen", "connect"), _ABOUT)


def client(_root: Path) -> str:
    """Return the configuration of a client."""
    return zenoh_file("pilot", _files("pilot", "connect"), _ABOUT)


def _files(name: str, *ways: str) -> dict[str, str]:
    fields = {"root_ca_certificate": f"{FOLDER}/ca.pem"}
    for way in ways:
        fields |= {f"{way}_certificate": f"{FOLDER}/{name}.pem", f"{way}_private_key": f"{FOLDER}/{name}.key"}
    return fields
