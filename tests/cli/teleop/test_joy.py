from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from lab.rigs.waiting import wait_until
from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.cli.mkctl.teleop import padsearch
from mkdaemon.cli.mkctl.teleop.devices import DeviceLostError, DeviceState
from mkdaemon.cli.mkctl.teleop.evdevpad import EvdevPad
from mkdaemon.cli.mkctl.teleop.joypad import GONE, JoyFinder, JoyPad, joy_fields
from mkdaemon.cli.mkctl.teleop.padsearch import Mappings, look_for_pads, only_pad
from mkdaemon.client.samples import Sample, read_payload
from mkdaemon.clock import Clock
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.telemetry.joy import Joy
from mkdaemon.virtualtime import run_virtually
from tests.cli.teleop.pipedpad import PipedPad
from tests.cli.teleop.rig import FakeDaemon
from tests.client.teleop.pads import FACTS, REST, gamepad

SECRET = "s3cret"


class FarPad:
    """A pad of another machine, as its program reads it."""

    name, facts = "/dev/input/event5", replace(FACTS, name="Far pad")


def joy(sequence: int, *, age: float = 0.0, id_: str = "045e:028e", **changes: float) -> Joy:
    state = DeviceState({**REST, **dict.fromkeys(FACTS.buttons, 0.0), **changes}, 10.0 - age)
    fields = joy_fields(FarPad(), id_, state, 10.0)  # type: ignore[arg-type]
    return Joy(stamp=Clock().stamp(), sequence=sequence, **fields)


def sample(message: Joy) -> Sample:
    """As it comes over the bus."""
    encoding = encoding_of(Joy)
    return Sample("joy/far", read_payload(encoding, encode(message)), encoding)


def test_proof_survives_the_bus_and_names_the_pad_and_the_secret() -> None:
    arrived = sample(joy(1, ABS_X=123).signed(SECRET, "far")).value
    assert arrived.is_by(SECRET, "far")
    assert not arrived.is_by("other", "far")
    assert not arrived.is_by(SECRET, "near")
    assert not arrived.model_copy(update={"sequence": 2}).is_by(SECRET, "far")
    assert not joy(1).is_by(SECRET, "far")
    assert not joy(1).model_copy(update={"proof": "no hex"}).is_by(SECRET, "far")


def test_names_and_values_must_be_as_many() -> None:
    fields = joy(1).model_dump()
    with pytest.raises(ValidationError, match="as many names"):
        Joy.model_validate({**fields, "axes": fields["axes"][1:]})


def test_joy_pad_is_as_old_as_its_newest_message() -> None:
    pad = JoyPad("far", SECRET, joy(1, age=0.1).signed(SECRET, "far"), 50.0)
    state = pad.ask(50.02)
    assert state is not None
    assert state.at == pytest.approx(49.9)
    assert pad.take(joy(2, ABS_X=32767).signed(SECRET, "far"), 51.0)
    state = pad.ask(51.0)
    assert state is not None
    assert (state.at, state.values["ABS_X"]) == (51.0, 1.0)
    with pytest.raises(DeviceLostError, match="has been silent for"):
        pad.ask(51.0 + GONE + 0.1)


def test_old_and_unsigned_messages_are_counted_and_change_nothing() -> None:
    pad = JoyPad("far", SECRET, joy(5).signed(SECRET, "far"), 50.0)
    assert not pad.take(joy(5, ABS_X=1.0).signed(SECRET, "far"), 51.0)
    assert not pad.take(joy(4, ABS_X=1.0).signed(SECRET, "far"), 51.0)
    assert not pad.take(joy(6, ABS_X=1.0), 51.0)
    assert pad.refused == 3
    assert pad.sequence == 5


def test_session_takes_a_signed_pad_and_no_other() -> None:
    async def main() -> None:
        session = FakeDaemon().session()
        finder = JoyFinder(session, "far", SECRET, Mappings(gamepad(), None))
        finder.take(sample(joy(1)))
        assert not session.devices
        assert "not signed" in session.notice
        finder.take(Sample("joy/far", {"sequence": -1}, encoding_of(Joy)))
        assert "is no Joy.v1" in session.notice
        finder.take(sample(joy(2).signed(SECRET, "far")))
        assert list(session.devices) == ["joy/far"]
        finder.take(sample(joy(3, ABS_Y=32767).signed(SECRET, "far")))
        session.tick()
        assert session.teleop.hands["joy/far"].has_seen_zero
        session.lost("joy/far", "gone")
        finder.take(sample(joy(3).signed(SECRET, "far")))  # a copy of an earlier one
        assert not session.devices
        finder.take(sample(joy(4).signed(SECRET, "far")))
        assert list(session.devices) == ["joy/far"]

    run_virtually(main())


def test_unknown_pad_is_told_of_with_the_advice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(padsearch, "load_mappings", list)

    async def main() -> str:
        session = FakeDaemon().session()
        JoyFinder(session, "far", SECRET, Mappings(None, None)).take(sample(joy(1).signed(SECRET, "far")))
        assert not session.devices
        return session.notice

    assert "mkctl teleop --learn" in run_virtually(main())


def test_mapping_of_this_machine_goes_before_that_of_mkdaemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert Mappings(None, None).of("045e:028e", "pad").name == "Xbox pad"
    own = tmp_path / "mkdaemon" / "gamepads"
    own.mkdir(parents=True)
    text = (
        'name = "Mine"\nids = ["045e:028e"]\n[channels]\naileron = "A"\nelevator = "B"\nthrottle = "C"\nrudder = "D"\n'
    )
    (own / "mine.toml").write_text(text + '[buttons]\nenable = "E"\n', encoding="utf-8")
    assert Mappings(None, None).of("045e:028e", "pad").name == "Mine"
    with pytest.raises(ConfigError, match=r"no mapping for odd pad \(1234:5678\)"):
        Mappings(None, None).of("1234:5678", "odd pad")


pytest.importorskip("evdev", reason="evdev is not installed: pip install 'mkdaemon[teleop]'")


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
