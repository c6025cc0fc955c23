"""The daemon's own recorder: what passes is in the file, its state is published; a configuration is read again."""

from __future__ import annotations

import asyncio
from pathlib import Path

import msgpack
import numpy as np
import pytest

from lab.rigs.waiting import wait_until
from mkdaemon.clock import Clock
from mkdaemon.config.reader import load
from mkdaemon.config.record import RecordedImages
from mkdaemon.config.root import Config
from mkdaemon.daemon import blackbox
from mkdaemon.daemon.audit import Audit
from mkdaemon.daemon.blackbox import ImageRecorder, open_black_box
from mkdaemon.daemon.reloading import Reloading
from mkdaemon.errors import ConfigError
from mkdaemon.record.entry import EntryKind, Notice
from mkdaemon.record.reader import Recording
from mkdaemon.vision.camera.image import CameraImage
from mkdaemon.vision.camera.imagecodec import unpack
from mkdaemon.vision.track.attitude import AttitudeHistory, AttitudeSample
from tests.daemon.procedures import procedure_rig


class Bus(procedure_rig.Bus):
    """Keeps what is published, and counts."""

    def counts(self):
        return {"health": 3}


def config(state, **record):
    return Config.model_validate(
        {"vehicle": {"name": "bb", "state_folder": state}, "record": {"free_mb": 1, "sync_s": 0, **record}}
    )


def recorded(folder):
    return [entry for path in sorted((folder / "recordings").glob("*.mcap")) for entry in Recording(path).entries()]


async def test_what_passes_is_in_the_file_when_the_daemon_has_ended(tmp_path):
    clock = Clock()
    box = open_black_box(config(tmp_path), clock, is_recording=False)
    async with box.run():
        box.bus_recorder.sample("health", b"\x80", "application/msgpack;mk.VehicleHealth.v1", clock.stamp())
        box.note_stop()
        box.tap.port_written(b"#b", clock.now(), "release")

    entries = recorded(tmp_path)
    assert [entry.kind for entry in entries] == [EntryKind.SAMPLE, EntryKind.NOTICE, EntryKind.PORT_WRITTEN]
    assert Notice.of(entries[1]) is Notice.STOP
    (path,) = (tmp_path / "recordings").glob("bb-*-000.mcap")
    recording = Recording(path)
    session = recording.read_session()
    assert (session.recorder, session.vehicle) == ("blackbox", "bb")
    assert Config.model_validate_json(session.config).vehicle.name == "bb"


async def test_its_state_and_the_counts_of_the_bus_are_published_every_second(tmp_path, monkeypatch):
    monkeypatch.setattr(blackbox, "PERIOD", 0.01)
    clock, bus = Clock(), Bus()
    box = open_black_box(config(tmp_path, json_for_viewers=True), clock, is_recording=False)
    async with box.run():
        box.note_stop()
        reporting = asyncio.create_task(box.report(bus, Audit(bus, clock)))
        await wait_until(lambda: any(status.file for status in bus.values("record/status")))
        (tmp_path / "recordings").rename(tmp_path / "elsewhere")
        await wait_until(lambda: bus.values("record/status")[-1].state == "fault")
        reporting.cancel()
    assert bus.values("bus/counts")[0].counts == {"health": 3}
    assert [event.level for event in bus.values("event/log")] == ["info", "warning"]
    assert bus.values("event/log")[0].text.endswith(".mcap")  # not before there is a file
    assert "has been removed" in bus.values("event/log")[1].text
    assert bus.values("record/status")[0].queue_limit_bytes == 32_000_000


@pytest.mark.parametrize("coding", ["jpeg", "png"])
async def test_images_are_recorded_at_the_rate_and_coding_asked_for(tmp_path, coding):
    clock = Clock()
    box = open_black_box(config(tmp_path), clock, is_recording=False)
    pixels = np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)
    async with box.run():
        record = box.image_recorder(RecordedImages(hz=5.0, coding=coding))
        never = box.image_recorder(RecordedImages(hz=0.0))
        for number in range(31):
            image = CameraImage(pixels, 100.0 + number / 30, 100.02 + number / 30, number, "front", "driver")
            attitude = AttitudeHistory([AttitudeSample(99.0 + number, 0.0, 0.0, 0.0)] if number else [])
            record(image, attitude)
            never(image, attitude)
    found = recorded(tmp_path)
    seen = [msgpack.unpackb(entry.payload) for entry in found if Notice.of(entry) is Notice.IMAGE_SEEN]
    assert [(one["sequence"], one["attitude"]) for one in seen[:2]] == [(0, None), (6, 105.0)]
    entries = [entry for entry in found if entry.kind is not EntryKind.NOTICE]
    assert len(entries) == len(seen) == 6
    assert {(entry.kind, entry.key, entry.issuer) for entry in entries} == {
        (EntryKind.IMAGE, "mk/bb/vision/front/image", "driver")
    }
    assert entries[0].received == pytest.approx(100.02)
    frame, decoded = unpack(entries[1].payload)
    assert (frame.coding, frame.sequence, frame.stamp.monotonic) == (coding, 6, pytest.approx(100.2))
    if coding == "png":
        assert np.array_equal(decoded, pixels)


class LogQueue:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.lines: asyncio.Queue[tuple[str, str]] = asyncio.Queue()

    def log(self, level: str, text: str) -> None:
        self.lines.put_nowait((level, text))


async def test_each_question_is_answered_in_the_log():
    running, audit, taken = load(None), LogQueue(), []
    files = iter(
        [
            load(None, {"vehicle.note": "one", "link.baud": 19200}),
            ConfigError("x.toml:3: link.prot: unknown key"),
            load(None, {"vehicle.note": "one"}),
        ]
    )

    def read():
        file = next(files)
        if isinstance(file, ConfigError):
            raise file
        return file

    reloading = Reloading(read)
    following = asyncio.create_task(reloading.follow(running, taken.append, audit))
    reloading.ask()
    assert await audit.lines.get() == ("info", "configuration reloaded: vehicle.note")
    assert await audit.lines.get() == ("warning", "needs a restart, on the ground: link.baud")
    reloading.ask()
    level, text = await audit.lines.get()
    assert level == "error"
    assert "the running one stays: x.toml:3" in text
    reloading.ask()
    assert await audit.lines.get() == ("info", "configuration reloaded: no key that can change at run time differs")
    assert [cfg.vehicle.note for cfg in taken] == ["one", "one"]
    assert all(cfg.link.baud == 57600 for cfg in taken)
    following.cancel()


def test_the_black_box_takes_up_its_room_and_its_images(tmp_path: Path):
    def configured(**record):
        return load(None, {"record.folder": str(tmp_path), **{f"record.{key}": value for key, value in record.items()}})

    box = open_black_box(configured(total_mb=10), Clock(), is_recording=False)
    recorder = box.image_recorder(RecordedImages()).__self__
    assert isinstance(recorder, ImageRecorder)
    wanted = configured(total_mb=7, images={"hz": 9.0})
    box.reconfigure(wanted.record)
    assert box._folder.limits.total_bytes == 7_000_000
    assert recorder._cfg.hz == 9.0
    off = open_black_box(configured(enabled=False), Clock(), is_recording=False)
    off.reconfigure(wanted.record)
    assert off.status().state == "off"
