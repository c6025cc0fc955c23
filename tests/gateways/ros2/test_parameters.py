"""The table of parameters, and what they mean."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.gateways.ros2.parameters import PARAMETERS, BoardSettings, Pace, settings_of
from tests.gateways.mavlink.rig import FakeVehicle


def test_a_rate_is_kept_by_the_stamps():
    pace = Pace({"imu": 10.0})
    through = [n for n in range(100) if pace.lets_through("imu", "imu", n * 0.02)]
    assert len(through) == 20
    assert all(pace.lets_through("fix", "fix", 0.0) for _ in range(3)), "without a limit everything goes"
    assert pace.lets_through("imu", "imu", 0.5), "a clock that begins again stops nothing"


GIVEN = {row.name: row.default for row in PARAMETERS}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("topics", ["imus"], "topics does not know imus"),
        ("cmd_vel.frame", "home", "cmd_vel.frame is body or pad"),
        ("take_off.height", 0.1, "take_off.height"),
        ("path.speed", 0.0, "path.speed"),
        ("path.speed", 6.0, "path.speed"),
        ("hold.seconds", float("inf"), "hold.seconds"),
        ("joy.mapping", "nopad", "there is 8bitdo"),
        ("joy.mapping", "no/such.toml", "no such configuration file"),
    ],
)
def test_a_wrong_parameter_is_named(name, value, words):
    with pytest.raises(ConfigError, match=words):
        settings_of(GIVEN | {name: value})


@pytest.fixture
def made(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    declared, board = {}, FakeVehicle()
    settings = BoardSettings(board, lambda name, value, about: declared.update({name: (value, about)}))
    return SimpleNamespace(board=board, settings=settings, declared=declared, folder=tmp_path)


def test_every_setting_is_a_parameter_and_a_set_that_nobody_knows_is_said(made):
    count = asyncio.run(made.settings.pull())
    assert count == len(made.declared) > 100 and all(name.startswith("settings.") for name in made.declared)
    assert made.declared["settings.gyro_p"][0] in range(256) and len(made.declared["settings.channels"][0]) == 12
    assert all(about for _, about in made.declared.values())
    made.board.raw = bytes([250, 1])
    with pytest.raises(MkError, match="layout"):
        asyncio.run(made.settings.pull())


def test_a_write_is_confirmed_and_the_set_is_saved_before(made):
    with pytest.raises(MkError, match="param/pull"):
        asyncio.run(made.settings.write("settings.gyro_p", 81))
    asyncio.run(made.settings.pull())
    for _ in range(2):
        asyncio.run(made.settings.write("settings.gyro_p", 81))
    asked = [(values, options) for name, values, options in made.board.calls if name == "write"]
    assert asked == [(({"gyro_p": 81},), {"confirm": True, "slot": 3})] * 2
    (saved,) = made.folder.rglob("before-*.toml")
    assert "gyro_p" in saved.read_text()
