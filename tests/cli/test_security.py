"""`mkdaemon security`: what the commands write, show and refuse; tests/bus/test_access_control.py connects with it."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from functools import partial

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.mkdaemon.security import certificates
from mkdaemon.cli.mkdaemon.security.roles import ROLES

FILES = ("daemon.json5", *(f"{role.name}.json5" for role in ROLES))


@pytest.fixture
def security(typed):
    return partial(typed, app, "security")


@pytest.fixture
def folder(tmp_path, security):
    assert security("new-ca", tmp_path / "keys", "ground.example", "192.168.7.1")[0] == 0
    return tmp_path / "keys"


def certificate_of(path):
    found = certificates.read_certificate(path)
    assert found is not None
    return found


@pytest.mark.parametrize("name", FILES)
def test_a_certificate_is_good_for_its_role_and_nothing_else(folder, name):
    certificate, authority = certificate_of(folder / name), certificate_of(folder / "ca.pem")
    certificate.verify_directly_issued_by(authority)
    assert certificates.describe_certificate(certificate).role == name.removesuffix(".json5")
    extensions = certificate.extensions
    assert extensions.get_extension_for_class(x509.BasicConstraints).value.ca is False
    uses = extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert (ExtendedKeyUsageOID.SERVER_AUTH in uses) is (name == "daemon.json5")
    hosts = certificates.describe_certificate(certificate).hosts
    assert hosts == (("localhost", "127.0.0.1", "ground.example", "192.168.7.1") if name == "daemon.json5" else ())
    assert b"PRIVATE" in (folder / "ca.key").read_bytes()
    assert ("access_control" in (folder / name).read_text(encoding="utf-8")) is (name == "daemon.json5")


def test_one_more_is_issued_and_shown(folder, security):
    code, out, _ = security("issue", "alice", "--role", "observer", "--ca", folder)
    assert code == 0
    assert "alice is observer" in out
    assert (
        security(
            "issue", "second", "--role", "daemon", "--host", "10.0.0.2", "--ca", folder, "-o", folder / "d2.json5"
        )[0]
        == 0
    )
    code, out, _ = security("show", folder)
    lines = {line.partition(":")[0].rpartition("/")[2]: line for line in out.splitlines()}
    assert (code, len(lines)) == (0, 8)
    assert "observer alice, until" in lines["alice.json5"]
    assert "(825 days)" in lines["alice.json5"] or "(824 days)" in lines["alice.json5"]
    assert "daemon second at localhost, 127.0.0.1, 10.0.0.2" in lines["d2.json5"]
    (line,) = map(json.loads, security("show", folder / "alice.json5", "--json")[1].splitlines())
    assert (line["role"], line["name"]) == ("observer", "alice")
    assert line["days"] > 800
    assert len(line["fingerprint"]) == 64


def test_a_certificate_that_has_ended_is_shown(folder, security):
    authority = certificates.load_authority(folder)
    past = datetime.now(UTC) - timedelta(days=20)
    pair = certificates.issue_certificate(authority, "pilot", "old", now=past, days=10)
    (folder / "old.pem").write_bytes(pair.certificate_pem)
    code, out, _ = security("show", folder)
    assert code == 1
    assert "pilot old, ENDED" in out


@pytest.mark.parametrize(
    ("words", "mistake"),
    [
        (("issue", "bob", "--ca", "none"), "no authority is in none"),
        (("issue", "bob", "--host", "x", "--ca", "{keys}"), "only a daemon or a router is reached at a host"),
        (("issue", "a/b", "--ca", "{keys}"), "a name has letters"),
        (("issue", "pilot", "--ca", "{keys}"), "already exists"),
        (("issue", "x" * 65, "--ca", "{keys}"), "at most 64"),
        (
            ("issue", "d", "--role", "daemon", "--host", "b\u00fccher", "--ca", "{keys}"),
            "no certificate can be made out",
        ),
        (("issue", "bob", "--days", "0", "--ca", "{keys}"), "--days 0: give 1 or more"),
        (("show", "{keys}/none"), "No such file"),
        (("show", "{keys}/ca.key"), "no certificate"),
    ],
)
def test_a_mistake_is_one_line(folder, security, words, mistake):
    code, _, err = security(*(word.replace("{keys}", str(folder)) for word in words))
    assert code == 2
    assert mistake in err
    assert err.count("\n") == 1


def test_an_authority_whose_files_do_not_belong_together_is_refused(folder, security, tmp_path):
    security("new-ca", tmp_path / "other")
    (folder / "ca.key").write_bytes((tmp_path / "other" / "ca.key").read_bytes())
    assert "ca.key is not the key of ca.pem" in security("issue", "bob", "--ca", folder)[2]
    (folder / "ca.key").write_text("nothing", encoding="utf-8")
    assert "are no certificate and its key" in security("issue", "bob", "--ca", folder)[2]
