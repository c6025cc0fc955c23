"""The hashes of what is installed on an aircraft's computer."""

from __future__ import annotations

import re
from importlib import metadata

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from mkdaemon.errors import MkError
from tests.places import ROOT
from tools.hashes import PAGE, requirements, spell

PINS = {
    canonicalize_name(name): version
    for name, version in (line.split("==") for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").split())
}
LINES = (ROOT / PAGE).read_text(encoding="utf-8").replace("\\\n", "").splitlines()
HASHED = {canonicalize_name(line.partition("==")[0]): line for line in LINES if not line.startswith("#")}


def needed():
    """Names of everything that gets installed, what is needed by what is needed included."""
    wanted, found = [Requirement(line) for line in requirements(ROOT)], set()
    while wanted:
        one = wanted.pop()
        if one.marker is not None and not one.marker.evaluate({"extra": ""}):
            continue
        name = canonicalize_name(one.name)
        if name not in found:
            found.add(name)
            wanted += [Requirement(line) for line in metadata.requires(name) or ()]
    return found


def test_everything_the_aircraft_needs_is_there_and_nothing_else():
    assert set(HASHED) == needed()


@pytest.mark.parametrize("name", HASHED)
def test_the_version_is_the_pinned_one_and_has_hashes(name):
    version, *hashes = HASHED[name].partition("==")[2].split()
    assert version == PINS[name]
    assert hashes
    assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", one) for one in hashes)
    assert len(set(hashes)) == len(hashes)


def reported(name, version, digest):
    return {
        "metadata": {"name": name, "version": version},
        "download_info": {"archive_info": {"hashes": {"sha256": digest}}},
    }


def test_files_of_every_machine_stand_under_one_version():
    text = spell([reported("B_c", "1", "f" * 64), reported("a", "2", "0" * 64), reported("B_c", "1", "e" * 64)])
    [a, *_, b] = text.partition("a==2")[2].partition("b-c==1")
    assert re.findall(r"sha256:(\w)", a) == ["0"]
    assert re.findall(r"sha256:(\w)", b) == ["e", "f"]


def test_two_versions_of_one_thing_are_refused():
    with pytest.raises(MkError, match=r"a has versions 1, 2: pin one"):
        spell([reported("a", "1", "0" * 64), reported("a", "2", "0" * 64)])
