"""`mkdaemon calibrate mount`: what a flight says against the camera file; written only when asked."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK, run
from mkdaemon.config.camera import MountSection
from mkdaemon.telemetry.selfcal import SelfCalibration
from mkdaemon.telemetry.vision import VisionStats
from mkdaemon.vision.camera.calibration_file import Camera, Intrinsics, load_camera, save_camera
from tests.client.fake import CLOCK, VEHICLE, fake_daemon, in_background
from tests.values import made

LENS = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5)
ESTIMATE = made(
    SelfCalibration, target="pad", looks=90, mounting_deg=(2.9, -1.0, 0.2), mounting_sd_deg=(0.2, 0.2, 1.3),
    mount_believed_deg=(1.0, 0.0, 0.0), mount_rpy_deg=(3.9, -1.0, 0.0),
)  # fmt: skip
VAGUE = ESTIMATE.model_copy(update={"target": "deck", "mounting_sd_deg": (2.2, 2.2, 5.0)})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "camera.toml"
    save_camera(Camera(intrinsics=LENS, mount=MountSection(rpy_deg=(1.0, 0.0, 0.0), looks="down")), path)
    return path


@asynccontextmanager
async def flown(**cameras: list[SelfCalibration]) -> AsyncIterator[list[str]]:
    """A daemon whose cameras tell this; yields where it is."""
    async with fake_daemon() as daemon:
        for name, estimates in cameras.items():
            stats = made(VisionStats, CLOCK.stamp(), camera=name, selfcal=tuple(estimates))
            daemon.bus.publish(f"vision/{name}/stats", stats)
        yield ["--vehicle", VEHICLE, "--connect", daemon.endpoint]


def mount(*words: object) -> int:
    return run(app, ["calibrate", "mount", *(str(word) for word in words)])


def test_both_are_shown_and_nothing_is_written(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = file.read_bytes()
    with in_background(flown(down=[VAGUE, ESTIMATE])) as at:
        assert mount(file, *at) == EXIT_OK
    out = capsys.readouterr().out
    assert "mount.rpy_deg  file 1.00, 0.00, 0.00  flight 3.90, -1.00, 0.00" in out
    assert "nothing written" in out
    assert file.read_bytes() == before


def test_it_is_stored_when_asked(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with in_background(flown(down=[ESTIMATE], front=[VAGUE])) as at:
        assert mount(file, *at, "--camera", "down", "--store", "--json") == EXIT_OK
    assert json.loads(capsys.readouterr().out)["stored"] is True
    after = load_camera(file)
    assert after.mount == MountSection(rpy_deg=(3.9, -1.0, 0.0))
    assert after.intrinsics == LENS


@pytest.mark.parametrize(
    ("cameras", "code", "words"),
    [
        ({}, EXIT_FAILURE, "no camera reports"),
        ({"down": [ESTIMATE], "front": [ESTIMATE]}, EXIT_FAILURE, "cameras down, front: give one with --camera"),
        ({"down": []}, EXIT_FAILURE, "fly over one first"),
        ({"down": [VAGUE]}, EXIT_FAILURE, "known to 2.2 deg after 90 images, 0.5 is needed: turn (yaw)"),
        (
            {"down": [ESTIMATE.model_copy(update={"mount_believed_deg": (0.0, 0.0, 0.0)})]},
            EXIT_CONFIG,
            "mount.rpy_deg 1.00, 0.00, 0.00, the daemon flies with 0.00, 0.00, 0.00",
        ),
    ],
    ids=["no camera", "two cameras", "no target", "no yaw", "another file"],
)
def test_what_is_not_known_is_not_stored(
    file: Path, capsys: pytest.CaptureFixture[str], cameras: dict[str, list[SelfCalibration]], code: int, words: str
) -> None:
    before = file.read_bytes()
    with in_background(flown(**cameras)) as at:
        assert mount(file, *at, "--store") == code
    assert words in capsys.readouterr().err
    assert file.read_bytes() == before
