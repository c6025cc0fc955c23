"""A daemon that reads its configuration again, and what takes the keys up."""

from __future__ import annotations

import asyncio
from pathlib import Path

from mkdaemon.clock import Clock
from mkdaemon.config.reader import load
from mkdaemon.config.record import RecordedImages
from mkdaemon.daemon.blackbox import ImageRecorder, open_black_box
from mkdaemon.daemon.reloading import Reloading
from mkdaemon.errors import ConfigError


class Audit:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.lines: asyncio.Queue[tuple[str, str]] = asyncio.Queue()

    def log(self, level: str, text: str) -> None:
        self.lines.put_nowait((level, text))


async def test_each_question_is_answered_in_the_log():
    running, audit, taken = load(None), Audit(), []
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
