"""The daemon's clients, as a user types them, against a whole daemon on the simulated boards."""

from __future__ import annotations

import asyncio
import json
import re
from contextlib import asynccontextmanager, contextmanager

import pytest

from lab.rigs.background import background_daemon
from lab.rigs.live import VEHICLE
from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.mkctl.streams import read_interval
from mkdaemon.cli.program import run
from mkdaemon.errors import ConfigError

pytestmark = [pytest.mark.flight, pytest.mark.real_time(tolerance=0.03)]
"""A standstill of a tenth of a second already degrades the link."""


@pytest.fixture
def serve():
    """Start a daemon, which `mkctl` finds by the environment."""

    @contextmanager
    def start(**sim):
        with background_daemon(**sim) as flown, pytest.MonkeyPatch.context() as patch:
            for name, value in {"MK_CONNECT": flown.endpoint, "MK_VEHICLE": VEHICLE, "COLUMNS": "200"}.items():
                patch.setenv(name, value)
            yield flown

    return start


@pytest.fixture
def mkctl(ctl):
    """Run `mkctl`: exit code, output, errors."""
    return lambda *arguments: ctl([], *arguments)


@asynccontextmanager
async def hold(client):
    """A lease somebody else holds and keeps renewing."""
    take = {"action": "take", "holder": "somebody", "force": True}
    granted = (await client.command("do", "lease", take)).require()
    name = {"epoch": granted["epoch"], "secret": granted["secret"]}

    async def renew():
        while True:
            await client.command("do", "lease", {"action": "renew", **name})
            await asyncio.sleep(0.5)

    renewing = asyncio.create_task(renew())
    try:
        yield name
    finally:
        renewing.cancel()


def test_a_first_look_around(serve, mkctl):
    with serve(board="nc", fc="2.12a") as flown:
        flown.wait_for_values("state/position", "health")
        code, out, _ = mkctl("status")
        assert code == 0
        for words in ("alive", "motors off", "nc 0.24", "free", "battery", "satellites"):
            assert words in out
        assert "up: " in out or "degraded: " in out  # a loaded machine may make it late
        code, out, _ = mkctl("status", "--json")
        assert '"is_alive": true' in out
        code, out, _ = mkctl("get", "rx/nc/osd", "state/battery")
        assert code == 0
        assert "rx/nc/osd" in out
        assert re.search(r"voltage +[\d.]+ V", out)
        assert "s ago" in out
        code, out, _ = mkctl("get", "state/*", "--json")
        assert {json.loads(line)["key"] for line in out.splitlines()} >= {"state/battery", "state/attitude"}
        code, out, _ = mkctl("watch", "state/attitude", "--count", "3", "--json")
        assert [json.loads(line)["key"] for line in out.splitlines()] == ["state/attitude"] * 3
        code, out, _ = mkctl("health")
        assert "link test" in out
        code, out, err = mkctl("board", "rates", "osd", "250ms")
        assert (code, "osd             250 ms" in out) == (0, True), out + err
        code, _, err = mkctl("board", "rates", "osd", "10ms")
        assert code == 1
        assert "line_budget" in err
        assert "% of the line" in err


def test_flying_by_hand_from_the_command_line(serve, mkctl):
    with serve() as flown:
        code, out, _ = mkctl("lease", "show")
        assert (code, out.strip()) == (0, "no client holds the lease")
        code, out, _ = mkctl("lease", "take", "--holder", "tester", "--json")
        assert (code, json.loads(out)["holder"]) == (0, "tester")
        with flown.other_client(hold) as lease:
            code, _, err = mkctl("lease", "take", "--holder", "other")
            assert (code, err.startswith("mkctl: lease_held: somebody holds the lease")) == (1, True)
            assert "--force" in err
            assert lease["epoch"] > 0
            assert mkctl("release")[0] == 0
        flown.wait_for_phase("free")
        fly = ("stick", "--throttle", "5", "--pitch", "-12", "--seconds", "0.5", "--json")
        code, out, err = mkctl(*fly)
        assert '"pitch": -12' in out, err
        flown.wait_for_phase("free")
        code, out, _ = mkctl("release")
        assert code == 0
        assert "the FlightCtrl confirmed it" in out


def test_mistakes_are_one_line(serve, mkctl):
    with serve():
        for arguments, words in (
            (("get", "state/nothing"), "no value for state/nothing"),
            (("get", "a//b"), "'a//b' is not a key: empty chunks are forbidden"),
            (("get", "--vehicle", "other"), "there is cockpit: use --vehicle"),
            (("watch", ""), "'' is not a key"),
            (
                ("watch", "state/atitude"),
                "no key matches 'state/atitude'; did you mean state/attitude or state/altitude?",
            ),
            (("status", "--vehicle", "other"), "there is cockpit: use --vehicle"),
            (("status", "--connect", "tcp/127.0.0.1:1"), "no program answers"),
            (("board", "rates", "osd"), "which interval"),
            (("stick", "--throttle", "0", "--pitch", "300"), "--pitch 300: give a number from -127 to 127"),
            (("stick", "--throttle", "nan"), "--throttle nan: give a number"),
            (("stick", "--throttle", "0", "--rate", "0"), "--rate 0: give a number above 0"),
            (("board", "rates", "osd", "soon"), "'soon' is not an interval"),
            (("board", "rates", "sod", "100ms"), "no stream"),
        ):
            code, _, err = mkctl(*arguments)
            assert code in {1, 2}
            assert words in err
            assert len(err.strip().splitlines()) == 1


def test_what_is_not_there_is_said_beside_what_is(serve, mkctl):
    with serve(board="nc") as flown:
        flown.wait_for_values("state/battery", "state/position")
        code, out, err = mkctl("get", "state/battery", "state/positon")
        hint = "did you mean state/position?"
        assert (code, err) == (0, f"mkctl: no value for state/positon of vehicle cockpit (yet); {hint}\n")
        assert re.match(r"state/battery  [\d.]+ s ago\n  voltage +[\d.]+ V\n", out)
        code, out, _ = mkctl("get", "mk/cockpit/state/battery")  # a whole key, as another program shows it
        assert (code, out.startswith("state/battery")) == (0, True)
        code, out, _ = mkctl("get", "**", "--json")
        keys = {json.loads(line)["key"] for line in out.splitlines()}
        assert {"link/state", "rx/nc/osd", "state/battery"} <= keys
        assert not any(key.startswith("schema/") for key in keys)
        code, out, _ = mkctl("get", "schema/Battery.v1", "--json")
        assert json.loads(out)["properties"]["voltage"]["type"] == "number"
        code, out, err = mkctl("watch", "--vehicle", "other", "--seconds", "0.1")
        assert (code, out) == (0, "")
        assert err.endswith("there is cockpit: use --vehicle; waiting for it\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["get", "--vehicle", "*"], "--vehicle '*': a name has lower-case letters, digits, - and _"),
        (["status", "--vehicle", "a/b"], "--vehicle 'a/b': a name has lower-case letters, digits, - and _"),
        (["watch", "--count", "0"], "--count 0: give 1 or more"),
        (["watch", "--seconds", "nan"], "--seconds nan: give a number above 0"),
        (
            ["status", "--connect", "here"],
            "--connect: 'here' is not a Zenoh endpoint; write it like tcp/127.0.0.1:7447",
        ),
        (["status", "--zenoh-file", "no.json5"], "no.json5: no usable Zenoh configuration"),
    ],
)
def test_what_cannot_be_meant_is_exit_code_2_before_anything_is_asked(arguments, words, capsys):
    assert run(app, arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.startswith(f"mkctl: {words}"), len(err.splitlines())) == ("", True, 1), err


@pytest.mark.parametrize(
    ("text", "seconds"), [("100ms", 0.1), ("100", 0.1), ("0.1s", 0.1), ("10Hz", 0.1), ("off", 0.0), ("0", 0.0)]
)
def test_intervals_in_the_units_people_write(text, seconds):
    assert read_interval(text) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "fast", "-5ms", "1 m"])
def test_intervals_that_are_none(text):
    with pytest.raises(ConfigError, match="not an interval"):
        read_interval(text)
