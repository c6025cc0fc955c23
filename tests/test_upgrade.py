"""Upgrade and roll-back as docs/operations.md describes them: two wheels, a folder for each, and a link to turn."""

from __future__ import annotations

import json
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from tests.places import ROOT

OLD_KEY = '    note: Annotated[str, RELOADABLE] = Field(default="", max_length=200)\n'
NEW_KEY = f'    colour: str = ""\n    """Of the airframe."""\n{OLD_KEY}'
MODULE = "mkdaemon/config/vehicle.py"


def next_release(wheel: Path, version: str) -> Path:
    """A wheel like this one, of another version and with one more key."""
    path = wheel.with_name(wheel.name.replace(wheel.name.split("-")[1], version))
    before = f"-{wheel.name.split('-')[1]}."
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.infolist():
            name, content = entry.filename, old.read(entry)
            if name == MODULE:
                text = content.decode()
                assert OLD_KEY in text
                content = text.replace(OLD_KEY, NEW_KEY).encode()
            elif name.endswith("METADATA"):
                content = content.replace(f"\nVersion: {before[1:-1]}\n".encode(), f"\nVersion: {version}\n".encode())
            elif name.endswith("RECORD"):  # its hashes hold no more
                content = b"".join(
                    f"{line.split(',')[0]},,\n".replace(before, f"-{version}.").encode()
                    for line in content.decode().splitlines()
                )
            entry.filename = name.replace(before, f"-{version}.", 1)
            new.writestr(entry, content)  # with the rights that the old one has
    return path


def install(wheel: Path, folder: Path) -> None:
    """Install a wheel into an environment of its own; what it needs is that of the tests."""
    environment = folder / ".venv"
    venv.create(environment, with_pip=False, symlinks=True)
    (packages,) = environment.glob("lib/python*/site-packages")
    (packages / "needed.pth").write_text(f"{sysconfig.get_path('purelib')}\n", encoding="utf-8")
    options = [
        "--quiet",
        "--no-index",
        "--no-deps",
        "--no-compile",
        "--ignore-installed",
        "--disable-pip-version-check",
    ]
    pip = [sys.executable, "-m", "pip", "--python", str(environment / "bin" / "python"), "install", *options]
    done = subprocess.run([*pip, str(wheel)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def opt(tmp_path_factory):
    """Two releases beside each other, and none in use yet."""
    folder = tmp_path_factory.mktemp("opt")
    [built] = WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])
    old = Path(built)
    install(old, folder / "mkdaemon-old")
    install(next_release(old, "99.0.0"), folder / "mkdaemon-new")
    return folder


def use(opt, release):
    link = opt / "mkdaemon"
    link.unlink(missing_ok=True)
    link.symlink_to(f"mkdaemon-{release}")


def mkdaemon(opt, *words):
    program = opt / "mkdaemon" / ".venv" / "bin" / "mkdaemon"
    done = subprocess.run([str(program), *map(str, words)], capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stdout, done.stderr


def test_a_release_is_taken_into_use_and_back_by_its_link(opt, tmp_path):
    path = tmp_path / "vehicle.toml"
    path.write_text('[vehicle]\nname = "mk7"\n', encoding="utf-8")
    seen = {}
    for release in ("old", "new", "old"):
        use(opt, release)
        code, out, err = mkdaemon(opt, "config", "show", path, "--changed", "--json")
        assert (code, err) == (0, "")
        assert json.loads(out)["value"] == "mk7"
        seen[release] = mkdaemon(opt, "--version")[1].strip()
    assert seen["new"] == "99.0.0" != seen["old"]

    path.write_text('[vehicle]\nname = "mk7"\ncolour = "red"\n', encoding="utf-8")
    code, out, err = mkdaemon(opt, "config", "show", path)
    assert (code, out) == (2, "")
    assert f"{path}:3: vehicle.colour: unknown key" in err
    use(opt, "new")
    assert 'colour = "red"' in mkdaemon(opt, "config", "show", path)[1]
