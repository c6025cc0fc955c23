from __future__ import annotations

import asyncio
from typing import Any

import pytest

from lab.rigs.handpad import HandKeyboard, HandPad
from mkdaemon.cli.mkctl.teleop.screen import BAR, COLUMNS, bar, screen_lines
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.cli.mkctl.teleop.watcher import SILENCE, Watcher
from mkdaemon.telemetry.control import ControlOutput, ControlStatus, Phase
from mkdaemon.virtualtime import run_virtually
from tests.cli.teleop.rig import FakeDaemon
from tests.values import made
from tools.top_picture import KNOWN


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


def test_screen_says_who_holds_the_lease_what_is_sent_and_what_is_wrong() -> None:
    text = "\n".join(show())
    for words in (
        "flies",
        "LIMITED",
        "LOW, 11.8 V",
        "on the ground",
        "up: both",
        "sent  -30",
        "answered",
        "BATTERY LOW",
    ):
        assert words in text


def test_screen_shows_what_would_be_sent_and_why_nothing_is() -> None:
    text = "\n".join(show(fly=False))
    assert "hold BTN_TL" in text
    assert "+30" in text


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


def test_screen_without_a_daemon_has_no_numbers() -> None:
    text = "\n".join(show(status=None))
    assert "NOTHING FROM THE DAEMON" in text
    assert text.count("not known") >= 5


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


def test_ground_is_known_only_while_somebody_says_so() -> None:
    async def main() -> None:
        watcher = Watcher()
        assert watcher.is_on_ground is None
        watcher.take("state/flight", value_of("state/flight", is_flying=True))
        assert watcher.is_on_ground is False
        watcher.take("state/flight", value_of("state/flight", is_flying=None))
        assert watcher.is_on_ground is None
        watcher.take("state/flight", value_of("state/flight", is_flying=False), 3.5)
        assert watcher.is_on_ground is None

    run_virtually(main())
