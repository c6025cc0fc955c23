"""An authority and what it certifies: keys on the curve P-256, X.509 version 3 (RFC 5280)."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.cli.mkdaemon.security.roles import SERVERS
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import LONGEST_SETTINGS, parse_json, read_text

NO_CRYPTOGRAPHY: Final = "certificates need cryptography, which is not installed: pip install 'mkdaemon[security]'"

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError as error:
    raise ConfigError(NO_CRYPTOGRAPHY) from error

AUTHORITY_DAYS: Final = 3650
EARLIER: Final = timedelta(days=1)
"""Certificates become valid this long before they are issued: a slow clock must not refuse them."""
TLS_FIELD: Final = "{}_{}_base64"
"""Of a Zenoh configuration: `connect_certificate_base64`."""


class Pair(NamedTuple):
    """A certificate and its private key.

    Attributes:
        certificate: what is shown to others.
        key: what proves it.
    """

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @property
    def certificate_pem(self) -> bytes:
        """The certificate as text."""
        return self.certificate.public_bytes(serialization.Encoding.PEM)

    @property
    def key_pem(self) -> bytes:
        """The private key as text, unencrypted."""
        form = serialization.PrivateFormat.PKCS8
        return self.key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())


class Certified(NamedTuple):
    """What a certificate says.

    Attributes:
        role: daemon, pilot, observer, recorder, source; of an authority its name.
        name: whose it is.
        hosts: names and addresses that a daemon or a router is reached at.
        until: when it ends.
        fingerprint: SHA-256 of the certificate, in hexadecimal digits.
    """

    role: str
    name: str
    hosts: tuple[str, ...]
    until: datetime
    fingerprint: str


def make_authority(now: datetime) -> Pair:
    """Make an authority.

    Args:
        now: from when on it counts.
    """
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "mkdaemon authority")])
    builder = (
        _builder(name, name, key, now, AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
    )
    return Pair(builder.sign(key, hashes.SHA256()), key)


def issue_certificate(
    authority: Pair, role: str, name: str, *, now: datetime, days: int, hosts: Sequence[str] = ()
) -> Pair:
    """Issue a certificate.

    Args:
        authority: who signs it.
        role: what its holder may do; its common name.
        name: whose it is.
        now: from when on it counts.
        days: how long it counts.
        hosts: names and addresses of a daemon or a router; a client's certificate is good for no host.

    Raises:
        ConfigError: the name is not valid.
    """
    key = ec.generate_private_key(ec.SECP256R1())
    try:
        subject = x509.Name(
            [x509.NameAttribute(NameOID.COMMON_NAME, role), x509.NameAttribute(NameOID.ORGANIZATIONAL_UNIT_NAME, name)]
        )
        names = [_host(host) for host in hosts]
    except ValueError as error:
        msg = f"{name}, {', '.join(hosts) or 'no host'}: no certificate can be made out to that: {error}"
        raise ConfigError(msg) from error
    # A daemon also connects, to a router for example.
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH] + [ExtendedKeyUsageOID.SERVER_AUTH] * (role in SERVERS)
    builder = (
        _builder(subject, authority.certificate.subject, key, now, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(_issuer(authority), critical=False)
    )
    if names:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return Pair(builder.sign(authority.key, hashes.SHA256()), key)


def load_authority(folder: Path) -> Pair:
    """Read an authority.

    Raises:
        ConfigError: there is none in this folder, or its files do not belong together.
    """
    try:
        certificate = x509.load_pem_x509_certificate(read_text(folder / "ca.pem").encode())
        key = serialization.load_pem_private_key(read_text(folder / "ca.key").encode(), None)
    except OSError as error:
        msg = f"{error.filename}: {error.strerror}: no authority is in {folder}; `mkdaemon security new-ca {folder}`"
        raise ConfigError(msg) from error
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{folder}: ca.pem and ca.key are no certificate and its key: {error}") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise ConfigError(f"{folder}: ca.key is not the key of ca.pem")
    return Pair(certificate, key)


def tls_fields(authority: x509.Certificate, pair: Pair, role: str) -> dict[str, str]:
    """What a Zenoh configuration says of certificates: all of it in the file itself, so that one file is enough."""
    ca = authority.public_bytes(serialization.Encoding.PEM)
    fields = {"root_ca_certificate_base64": ca}
    for way in ("connect", "listen") if role in SERVERS else ("connect",):
        fields[TLS_FIELD.format(way, "certificate")] = pair.certificate_pem
        fields[TLS_FIELD.format(way, "private_key")] = pair.key_pem
    return {name: base64.b64encode(content).decode() for name, content in fields.items()}


def read_certificate(path: Path) -> x509.Certificate | None:
    """The certificate of a PEM file, or of a Zenoh configuration made here; None where there is none.

    Raises:
        ConfigError: the file cannot be read.
    """
    try:
        text = read_text(path, limit=LONGEST_SETTINGS)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: {getattr(error, 'strerror', None) or 'not UTF-8 text'}") from error
    try:
        if "-----BEGIN CERTIFICATE" in text:
            return x509.load_pem_x509_certificate(text.encode())
        lines = [line for line in text.splitlines() if not line.startswith("//")]
        tls = parse_json("\n".join(lines))["transport"]["link"]["tls"]
        return x509.load_pem_x509_certificate(base64.b64decode(tls[TLS_FIELD.format("connect", "certificate")]))
    except (ValueError, KeyError, TypeError):
        return None


def describe_certificate(certificate: x509.Certificate) -> Certified:
    """What a certificate says."""

    def of_subject(kind: x509.ObjectIdentifier) -> str:
        return next((str(found.value) for found in certificate.subject.get_attributes_for_oid(kind)), "")

    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        hosts = tuple(str(name.value) for name in names)
    except x509.ExtensionNotFound:
        hosts = ()
    return Certified(
        role=of_subject(NameOID.COMMON_NAME),
        name=of_subject(NameOID.ORGANIZATIONAL_UNIT_NAME),
        hosts=hosts,
        until=certificate.not_valid_after_utc,
        fingerprint=certificate.fingerprint(hashes.SHA256()).hex(),
    )


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, now: datetime, days: int
) -> x509.CertificateBuilder:
    """What all certificates have in common."""
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now.astimezone(UTC) - EARLIER)
        .not_valid_after(now.astimezone(UTC) + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _issuer(authority: Pair) -> x509.AuthorityKeyIdentifier:
    return x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key())


def _host(text: str) -> x509.GeneralName:
    """A host as a certificate names it."""
    try:
        return x509.IPAddress(ip_address(text))
    except ValueError:
        return x509.DNSName(text)


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    """What a key may be used for."""
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
