"""Whatever a command writes: never over a file without `--force`, and a full disk leaves what was there."""

from __future__ import annotations

import json
import resource
from contextlib import contextmanager

import pytest

from mkdaemon import guard
from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.client.settings_files import write_backup
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.settings import SettingsBackup, StoredSet
from mkdaemon.vision.camera.calibration_file import load_camera, save_camera
from mkdaemon.vision.camera.imagecodec import write_picture
from mksim.boards.parameters import factory_set
from tests.places import CONFIGS, ROOT

OLD = b"what was there"
MISSION = "latitude,longitude,altitude\n47.1,8.1,10\n47.1001,8.1,10\n"


@contextmanager
def full_disk():
    """No file of this process grows above 20 bytes: what a full disk does to a write."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def print_target(folder, *words):
    return mkdaemon, folder / "x.svg", ["calibrate", "print", folder / "x.svg", "--tag", "7:0.16", *words]


def print_board(folder, *words):
    return mkdaemon, folder / "x.pdf", ["calibrate", "print", folder / "x.pdf", "--charuco", "9x6", *words]


def write_target_file(folder, *words):
    own = folder / "own.toml"
    return mkdaemon, own, ["calibrate", "print", folder / "y.svg", "--tag", "7:0.16", "--write-target", own, *words]


def convert_mission(folder, *words):
    (folder / "m.csv").write_text(MISSION)
    return mkctl, folder / "x.gpx", ["waypoints", "convert", folder / "m.csv", folder / "x.gpx", *words]


COMMANDS = [print_target, print_board, write_target_file, convert_mission]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
def test_a_command_overwrites_only_with_force_and_never_on_a_full_disk(command, tmp_path, capsys):
    app, file, words = command(tmp_path)
    file.write_bytes(OLD)
    assert run(app, [str(word) for word in words]) == EXIT_CONFIG
    assert f"{file}: already exists; choose another name, or overwrite it with --force" in capsys.readouterr().err
    app, file, words = command(tmp_path, "--force")
    names = sorted(tmp_path.iterdir())
    with full_disk():
        assert run(app, [str(word) for word in words]) == EXIT_FAILURE
    assert f"{file}: cannot be written (File too large); choose another place" in capsys.readouterr().err
    assert file.read_bytes() == OLD
    assert sorted(tmp_path.iterdir()) == names
    assert run(app, [str(word) for word in words]) == EXIT_OK
    assert file.read_bytes() != OLD


def save_lens(file, *, overwrite):
    save_camera(load_camera(CONFIGS / "cameras" / "sim.toml"), file, overwrite=overwrite)


def save_overlay(file, *, overwrite):
    import numpy as np

    write_picture(file.with_suffix(".png"), np.zeros((8, 8, 3), np.uint8), overwrite=overwrite)


def save_settings(file, *, overwrite):
    raw = factory_set(95, 3)
    found = SettingsBackup(active=3, firmware="2.12a", sets=(StoredSet(slot=3, raw=raw),))
    write_backup(file, found, (3,), overwrite=overwrite)


@pytest.mark.parametrize("write", [save_lens, save_overlay, save_settings], ids=lambda write: write.__name__)
def test_a_writer_overwrites_only_when_asked_for_and_never_on_a_full_disk(write, tmp_path):
    file = tmp_path / ("x.png" if write is save_overlay else "x.toml")
    file.write_bytes(OLD)
    with pytest.raises(ConfigError, match=r"already exists; .* --force"):
        write(file, overwrite=False)
    with pytest.raises(MkError, match=r"cannot be written .File too large."), full_disk():
        write(file, overwrite=True)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [OLD]


def test_the_guard_keeps_an_earlier_report_on_a_full_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(guard.signal, "alarm", lambda seconds: None)
    report = tmp_path / "guard.json"
    report.write_bytes(OLD)
    with full_disk():
        guard._write_report("released", report)
    assert report.read_bytes() == OLD
    guard._write_report("released", report)
    assert json.loads(report.read_text())["text"] == "released"


def test_nothing_of_the_product_writes_a_file_another_way():
    """`files.py` writes whole files; a video grows beside its place, the guard stands alone, /proc is no disk."""
    ways = (".write_text(", ".write_bytes(", "imwrite(", 'open("w', "tofile(", "cv2.VideoWriter(")
    allowed = {"guard.py", "outputs.py", "priority.py"}
    found = {
        path.name
        for path in sorted((ROOT / "src").rglob("*.py"))
        if any(way in path.read_text(encoding="utf-8") for way in ways)
    }
    assert found - allowed - {"files.py"} == set()
