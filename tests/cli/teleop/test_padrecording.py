from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lab.rigs.handpad import HandPad
from mkdaemon.cli.mkctl.teleop.padrecording import PadRecorder, read_recording
from mkdaemon.cli.mkctl.teleop.padreplay import feed, require_simulator
from mkdaemon.client import LastValue
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.virtualtime import run_virtually
from tests.cli.teleop.rig import FakeDaemon

Streamed = list[tuple[str, dict[str, Any]]]


def record(path: Path) -> Streamed:
    """Fly for two seconds and unplug the pad; returns what was streamed."""
    daemon = FakeDaemon()

    async def main() -> None:
        session, stop = daemon.session(), asyncio.Event()
        with path.open("w", encoding="utf-8") as file:
            session.recorder = PadRecorder(file, session.now)
            running = asyncio.create_task(session.run(stop))
            pad = HandPad(session)
            pad.plug_in()
            await asyncio.sleep(0.1)
            pad.move(ABS_Y=1.0)
            pad.move(ABS_Y=0.0, BTN_TL=1)
            for number in range(20):
                await asyncio.sleep(0.0513)
                pad.move(ABS_RX=number / 20)
            pad.unplug(is_noticed=True)
            await asyncio.sleep(0.1)
            stop.set()
            await running

    run_virtually(main())
    return daemon.lease.streamed


def replay(path: Path) -> Streamed:
    daemon = FakeDaemon()

    async def main() -> None:
        session, stop = daemon.session(), asyncio.Event()
        running = asyncio.create_task(session.run(stop))
        await feed(session, read_recording(path))
        await asyncio.sleep(0.1)
        assert not session.devices
        stop.set()
        await running

    run_virtually(main())
    assert daemon.given_back == 1
    return daemon.lease.streamed


def changes(streamed: Streamed) -> Streamed:
    return [one for before, one in zip([None, *streamed], streamed, strict=False) if one != before]


def test_replayed_session_streams_what_the_recorded_one_did(tmp_path: Path) -> None:
    path = tmp_path / "flight.jsonl"
    flown = record(path)
    again = replay(path)
    assert changes(again) == changes(flown)
    assert len(again) == pytest.approx(len(flown), abs=3)


def test_recording_that_ends_in_flight_lets_go_at_its_end(tmp_path: Path) -> None:
    path = tmp_path / "flight.jsonl"
    record(path)
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    cut = [line for line in lines[: len(lines) // 2] if '"lost"' not in line]
    path.write_text("".join(cut) + '{"t": 9, "ev', encoding="utf-8")
    assert replay(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no recording"),
        ('{"t":0,"event":"lost"}\n', "no recording"),
        ('{"t":0,"event":"start","version":2}\n', "another version"),
        ('{"t":0,"event":"start"}\nnonsense\n', "jsonl:2: .*JSON"),
        ('{"t":0,"event":"start"}\n{"t":1,"event":"attach","device":"x"}\n', "jsonl:2: a device without facts"),
        (
            '{"t":0,"event":"start"}\n{"t":1,"event":"state"}\n{"t":0.5,"event":"state"}\n',
            "jsonl:3: time goes backwards",
        ),
        ('{"t":0,"event":"start","speed":3}\n', "jsonl:1: speed"),
    ],
)
def test_what_is_no_recording_is_refused_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "flight.jsonl"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        read_recording(path)


class FakeBus:
    """The last values of the simulator and of the daemon."""

    def __init__(self, truth: Any, link: Any, age: float = 0.1) -> None:
        self.sim, self.link = SimpleNamespace(truth=Last(truth, age)), SimpleNamespace(state=Last(link, age))


class Last:
    """The last value of a key."""

    def __init__(self, value: Any, age: float) -> None:
        self._reading = None if value is None else LastValue(value, age)

    async def latest(self) -> Any:
        return self._reading


def shown(port: str, boot: str = "b1") -> Any:
    return SimpleNamespace(port=port, stamp=SimpleNamespace(boot=boot))


@pytest.mark.parametrize("port", ["/dev/pts/4", "pty:/dev/pts/4"])
async def test_port_that_the_simulator_holds_is_a_simulators(port: str) -> None:
    await require_simulator(FakeBus(shown("/dev/pts/4"), shown(port)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("truth", "link", "age"),
    [
        (None, shown("/dev/pts/4"), 0.1),
        (shown("/dev/pts/4"), None, 0.1),
        (shown("/dev/pts/4"), shown("/dev/pts/4"), 1.1),
        (shown("/dev/pts/4"), shown("/dev/ttyUSB0"), 0.1),
        (shown("/dev/pts/4"), shown("/dev/pts/5"), 0.1),
        (shown("/dev/pts/4"), shown("/dev/pts/4", boot="b2"), 0.1),
        (shown("tcp://host:1"), shown("tcp://host:1"), 0.1),
        (shown("/dev/ttyUSB0"), shown("/dev/ttyUSB0"), 0.1),
        (shown(""), shown(""), 0.1),
    ],
)
async def test_anything_but_the_simulators_own_port_is_refused(truth: Any, link: Any, age: float) -> None:
    with pytest.raises(CommandRejectedError) as refused:
        await require_simulator(FakeBus(truth, link, age))  # type: ignore[arg-type]
    assert refused.value.token == "not_simulated"
