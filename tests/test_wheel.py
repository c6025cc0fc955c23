"""The wheel: only the product in it, and the base installation needs only what flight needs."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
import zipfile

import pytest
from hatchling.builders.wheel import WheelBuilder
from packaging.requirements import Requirement

from tests.places import CONFIGS, ROOT

SAMPLES = "share/mkdaemon/configs"

NEEDED_TO_FLY = {
    "cyclopts", "eclipse-zenoh", "lz4", "mcap", "msgpack", "numpy", "pydantic", "pyserial", "pyserial-asyncio", "rich",
    "structlog", "uvloop", "zstandard",
}  # fmt: skip


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    [path] = WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])
    with zipfile.ZipFile(path) as opened:
        yield opened


def test_the_wheel_holds_the_product_and_nothing_else(wheel):
    names = [name for name in wheel.namelist() if f"{SAMPLES}/" not in name]
    assert {name.split("/")[0].partition("-")[0] for name in names} == {"mkdaemon", "mksim"}
    sources = {path.relative_to(ROOT / "src").as_posix() for path in (ROOT / "src").rglob("*.py")}
    assert {name for name in names if name.endswith(".py")} == sources
    assert not any(room in name.split("/") for name in names for room in ("lab", "tools", "tests", "bench"))


def test_the_wheel_brings_the_sample_configurations(wheel):
    inside = {name.partition(f"{SAMPLES}/")[2] for name in wheel.namelist() if f".data/data/{SAMPLES}/" in name}
    assert inside == {path.relative_to(CONFIGS).as_posix() for path in CONFIGS.rglob("*") if path.is_file()}


def test_the_wheel_brings_the_page_of_the_viewer_and_the_help_of_the_commands(wheel):
    assert "mkdaemon/cli/help.json" in wheel.namelist()
    folder = ROOT / "src" / "mkdaemon" / "view" / "page" / "static"
    inside = {name.rpartition("/")[2] for name in wheel.namelist() if "/view/page/static/" in name}
    assert inside == {path.name for path in folder.iterdir()} != set()


def test_the_wheel_has_both_programs_and_the_licence(wheel):
    programs = {name.rpartition("/")[2]: name for name in wheel.namelist() if ".data/scripts/" in name}
    assert programs.keys() == {"mkctl", "mkdaemon"}
    for program, name in programs.items():
        lines = wheel.read(name).decode().splitlines()
        assert lines[0] == "#!python", "the installer puts its own interpreter there"
        statements = [line for line in lines if line and not line.startswith("#")]
        # Whatever else is imported, an interrupt must not show a traceback of it.
        assert statements[:2] == ["import _signal", "_signal.signal(_signal.SIGINT, _signal.SIG_DFL)"]
        assert statements[-1] == f"{program}()"
    assert any(name.endswith("licenses/LICENSE") for name in wheel.namelist())


def test_the_base_installation_needs_only_what_flight_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {Requirement(line).name for line in project["dependencies"]} == NEEDED_TO_FLY
    assert {Requirement(line).name for line in project["optional-dependencies"]["vision"]} == {
        "opencv-python-headless",
        "pyapriltags",
        "ruamel.yaml",
        "simplejpeg",
    }


def git(folder, *words):
    command = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b", *words]
    return subprocess.run(command, check=True, capture_output=True).stdout


def version_of(folder):
    """The version that a build of a tree has."""
    command = [sys.executable, "-m", "hatchling", "version"]
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


def test_the_version_is_that_of_the_tag_and_every_copy_of_the_tree_has_one(tmp_path):
    tree, archive = tmp_path / "tree", tmp_path / "archive"
    for folder in (tree, archive):
        folder.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitattributes", ".git_archival.txt"):
        shutil.copy(ROOT / name, tree)
    assert version_of(tree) == "0.0"
    git(tree, "init", "--quiet")
    git(tree, "add", "--all")
    git(tree, "commit", "--quiet", "--message", "first")
    assert version_of(tree).startswith("0.1.dev1+g")
    git(tree, "tag", "v9.8.7")
    assert version_of(tree) == "9.8.7"
    (tmp_path / "tree.tar").write_bytes(git(tree, "archive", "HEAD"))
    shutil.unpack_archive(tmp_path / "tree.tar", archive)
    assert version_of(archive) == "9.8.7"
    git(tree, "commit", "--quiet", "--allow-empty", "--message", "second")
    assert version_of(tree).startswith("9.8.8.dev1+g")
