"""The session of `mkctl teleop`: the lease it takes, what it streams, records and plays again, and its screen."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lab.rigs.handpad import HandKeyboard, HandPad
from mkdaemon.cli.mkctl.teleop.padrecording import PadRecorder, read_recording
from mkdaemon.cli.mkctl.teleop.padreplay import feed, require_simulator
from mkdaemon.cli.mkctl.teleop.screen import BAR, COLUMNS, bar, screen_lines
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.cli.mkctl.teleop.watcher import SILENCE, Watcher
from mkdaemon.client import LastValue
from mkdaemon.errors import CommandRejectedError, ConfigError
from mkdaemon.telemetry.control import ControlOutput, ControlStatus, Phase
from mkdaemon.virtualtime import run_virtually
from tests.cli.teleop.rig import FakeDaemon
from tests.reading.knownflight import KNOWN
from tests.values import made


def fly(daemon: FakeDaemon, story: Callable[[TeleopSession, HandPad], Awaitable[None]]) -> TeleopSession:
    """Plug a pad in, make it ready, press its enable button, and let the story happen."""

    async def main() -> TeleopSession:
        session, stop = daemon.session(), asyncio.Event()
        running = asyncio.create_task(session.run(stop))
        pad = HandPad(session)
        pad.plug_in()
        await asyncio.sleep(0.05)
        pad.move(ABS_Y=1.0)
        pad.move(ABS_Y=0.0, BTN_TL=1)
        await asyncio.sleep(0.1)
        await story(session, pad)
        stop.set()
        await running
        return session

    return run_virtually(main())


def test_change_is_streamed_at_once_and_not_at_the_next_period() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        await asyncio.sleep(0.0155)
        before = len(daemon.lease.streamed)
        pad.move(ABS_RX=1.0)
        await asyncio.sleep(0.011)
        assert [fields["roll"] for _, fields in daemon.lease.streamed[before:]][:1] == [30.0]

    fly(daemon, story)


def test_unplugged_pad_gives_the_lease_back_at_once() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        pad.unplug(is_noticed=True)
        await asyncio.sleep(0.03)
        assert daemon.given_back == 1

    assert "unplugged" in fly(daemon, story).notice


def test_lost_lease_ends_the_flight_until_the_enable_button_is_pressed_anew() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        daemon.lease.lose("somebody took it")
        await asyncio.sleep(0.1)
        assert "somebody took it" in session.output.reason
        await asyncio.sleep(0.5)
        assert daemon.taken == 1
        pad.move(BTN_TL=0)
        pad.move(BTN_TL=1)
        await asyncio.sleep(0.1)
        assert daemon.taken == 2

    fly(daemon, story)


def test_refused_setpoint_is_told() -> None:
    daemon = FakeDaemon()

    async def story(session: TeleopSession, pad: HandPad) -> None:
        daemon.lease.refuse(CommandRejectedError("no_estimate", "no target is seen.", "fly over one"))
        await asyncio.sleep(0.1)

    assert "no target is seen" in fly(daemon, story).notice


def test_alarm_shakes_every_pad_and_reports_and_loss_of_an_unknown_device_change_nothing() -> None:
    async def story(session: TeleopSession, pad: HandPad) -> None:
        session.reported("other", "ABS_X", 1.0, session.now)
        session.lost("other", "gone")
        await asyncio.sleep(0.1)
        assert session.teleop.pilot == "pad"
        session.alarm("the link is down")
        assert pad.alarms == 1

    assert fly(FakeDaemon(), story).notice == "the link is down"


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


def value_of(key: str, **changes: object) -> Any:
    """A known value of a key with some fields changed."""
    return type(KNOWN[key]).model_validate(KNOWN[key].model_dump() | changes)


STATUS = value_of("control/status", phase="flying", manoeuvre="stick", stage="")
LONG = "A pad with a name that is longer than its column"
OUTPUT = made(ControlOutput, STATUS.stamp, pitch=12, roll=-30, throttle=-2, limited=True)


def show(*, keyboard: bool = False, fly: bool = True, status: ControlStatus | None = STATUS) -> list[str]:
    async def main() -> list[str]:
        session: TeleopSession = FakeDaemon().session()
        pad = HandKeyboard(session) if keyboard else HandPad(session, LONG)
        pad.plug_in()
        watcher = Watcher()
        session.tick()
        if isinstance(pad, HandPad):
            pad.move(ABS_Y=1.0)
            pad.move(ABS_Y=0.0, ABS_RX=1.0, BTN_TL=float(fly))
        session.tick()
        await asyncio.sleep(0.01)
        if status is not None:
            watcher.take("control/status", status)
            watcher.take("control/output", OUTPUT)
            watcher.take("state/battery", value_of("state/battery", voltage=11.84, is_low=True))
            watcher.take("state/flight", value_of("state/flight", is_flying=False), 1.0)
            watcher.take("link/health", KNOWN["link/health"])
        lines = screen_lines(session, watcher, "mk1 at tcp/127.0.0.1:7447", has_keyboard=keyboard)
        await session.keeper.close()
        return [line.plain for line in lines]

    return run_virtually(main())


@pytest.mark.parametrize("keyboard", [False, True])
@pytest.mark.parametrize("status", [STATUS, None])
def test_screen_fits_80_columns_and_24_lines_of_plain_letters(keyboard: bool, status: ControlStatus | None) -> None:
    lines = show(keyboard=keyboard, status=status)
    assert len(lines) <= 22
    assert max(map(len, lines)) < COLUMNS
    assert "".join(lines).isascii()


def test_screen_says_what_the_daemon_waits_for() -> None:
    async def main() -> str:
        daemon = FakeDaemon()
        daemon.lease.engages = None
        session = daemon.session()
        pad = HandPad(session)
        pad.plug_in()
        session.tick()
        pad.move(ABS_Y=1.0)
        pad.move(ABS_Y=0.0, BTN_TL=1)
        session.tick()
        asked = "\n".join(line.plain for line in screen_lines(session, Watcher(), "x", has_keyboard=False))
        await asyncio.sleep(0.01)
        daemon.lease.report(Phase.LEASED, reason="operator streams; waiting for neutral sticks")
        session.tick()
        lines = screen_lines(session, Watcher(), "x", has_keyboard=False)
        await session.keeper.close()
        return asked + "\n".join(line.plain for line in lines)

    text = run_virtually(main())
    assert "the lease is requested" in text
    assert "waiting for neutral sticks" in text


@pytest.mark.parametrize(
    ("value", "sent", "letters"),
    [(0, None, {"|": 1}), (127, None, {"#": 20, "|": 1}), (-127, 127, {"#": 20, "|": 1, "o": 1}), (None, 0, {"o": 1})],
)
def test_bar_runs_from_its_middle(value: float | None, sent: float | None, letters: dict[str, int]) -> None:
    text = bar(value, sent)
    assert len(text) == BAR
    assert {letter: text.count(letter) for letter in "#|o" if letter in text} == letters


def test_reach_is_lost_with_the_daemon_or_the_link_and_told_once() -> None:
    async def main() -> list[str]:
        watcher, alarms = Watcher(), []
        watching = asyncio.create_task(watcher.watch_reach(alarms.append))
        watcher.take("control/status", STATUS)
        watcher.take("link/state", value_of("link/state"))
        await asyncio.sleep(1.0)
        assert watcher.trouble == ""
        watcher.take("link/state", value_of("link/state", condition="mute", reason="no byte"))
        await asyncio.sleep(0.5)
        watcher.take("link/state", value_of("link/state", condition="degraded"))
        await asyncio.sleep(SILENCE)
        watching.cancel()
        return alarms

    alarms = run_virtually(main())
    assert alarms[0] == "the link is mute: no byte"
    assert "has been silent" in alarms[1]
    assert len(alarms) == 2
