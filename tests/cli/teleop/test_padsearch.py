from __future__ import annotations

import asyncio

import pytest

pytest.importorskip("evdev", reason="evdev is not installed: pip install 'mkdaemon[teleop]'")

from lab.rigs.pipedpad import PipedPad
from lab.rigs.waiting import wait_until
from mkdaemon.cli.mkctl.teleop import padsearch
from mkdaemon.cli.mkctl.teleop.evdevpad import EvdevPad
from mkdaemon.cli.mkctl.teleop.padsearch import Mappings, look_for_pads, only_pad
from mkdaemon.errors import MkError
from tests.cli.teleop.rig import FakeDaemon
from tests.client.teleop.pads import gamepad


class InputFolder:
    """The device files of a machine."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.devices: dict[str, PipedPad] = {}
        self.is_forbidden = False
        monkeypatch.setattr(padsearch, "LOOKING", 0.01)
        monkeypatch.setattr(padsearch, "new_paths", lambda known: sorted(set(self.devices) - set(known)))
        monkeypatch.setattr(padsearch, "open_pad", self.open)

    def open(self, path: str, report: object) -> EvdevPad | None:
        if self.is_forbidden:
            raise PermissionError(13, "Permission denied")
        device = self.devices[path]
        return EvdevPad(device, report) if device.info.vendor else None  # type: ignore[arg-type]


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> InputFolder:
    return InputFolder(monkeypatch)


async def test_pads_are_attached_when_they_come_and_again_when_they_come_back(folder: InputFolder) -> None:
    session = FakeDaemon().session()
    looking = asyncio.create_task(look_for_pads(session, Mappings(gamepad(), None)))
    await asyncio.sleep(0.02)
    folder.devices["event1"] = PipedPad("event1")
    await wait_until(lambda: "event1" in session.devices)
    folder.devices["event2"] = PipedPad("event2")
    await wait_until(lambda: "event2" in session.devices)
    session.lost("event1", "unplugged")
    folder.devices["event1"] = PipedPad("event1")  # the same path, between two looks
    await wait_until(lambda: "event1" in session.devices)
    looking.cancel()
    for device in session.devices.values():
        device.close()


async def test_pad_without_a_mapping_is_left_out_and_told_of(folder: InputFolder) -> None:
    session = FakeDaemon().session()
    folder.devices["event1"] = PipedPad("event1", ids=(0x1234, 0x5678))
    looking = asyncio.create_task(look_for_pads(session, Mappings(None, None)))
    await wait_until(lambda: "1234:5678" in session.notice)
    assert "--learn" in session.notice
    assert not session.devices
    looking.cancel()


async def test_pad_that_may_not_be_opened_is_tried_again(folder: InputFolder) -> None:
    session = FakeDaemon().session()
    folder.is_forbidden = True
    folder.devices["event1"] = PipedPad("event1")
    looking = asyncio.create_task(look_for_pads(session, Mappings(gamepad(), None)))
    await wait_until(lambda: "group `input`" in session.notice)
    folder.is_forbidden = False
    await wait_until(lambda: "event1" in session.devices)
    looking.cancel()
    session.devices["event1"].close()


async def test_the_only_pad_is_taken_and_two_are_refused(folder: InputFolder) -> None:
    with pytest.raises(MkError, match="no pad: plug one in"):
        only_pad(asyncio.Event())
    folder.devices["event1"] = PipedPad("event1")
    news = asyncio.Event()
    pad = only_pad(news)
    folder.devices["event1"].move(ABS_X=5)
    async with asyncio.timeout(5):
        await news.wait()
    pad.close()
    folder.devices = {"event1": PipedPad("event1"), "event2": PipedPad("event2")}
    with pytest.raises(MkError, match="leave one"):
        only_pad(asyncio.Event())
