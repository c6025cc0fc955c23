"""Nothing that somebody else wrote acts on a terminal, or passes for a line of ours, whichever command prints it."""

from __future__ import annotations

import asyncio
import re
import sys
import unicodedata
from dataclasses import replace

import msgpack
import pytest
import structlog

from mkdaemon.cli.mkctl.app import app as mkctl
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.mkdaemon.logs import spell_values
from mkdaemon.cli.program import run
from mkdaemon.cli.terminal import drawing_stream, guarded_streams, on_one_line, spelled
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.writer import RecordingWriter
from mkdaemon.telemetry.event import LogEvent
from tests.client.fake import CLOCK, VEHICLE, fake_daemon
from tests.record.support import SESSION, sample

EVIL = (
    "\x1b[2J\x1b]0;title\x07\x1b]8;;http://a\x1b\\x\x1b]8;;\x1b\\\x9b31m\x85\u202egnp\u2066\u200f\u2028\r\nFAKED\n"
    "FAKED\t\x00\x08[bold red]B[/] :smile: \ufeff\xad\u200b\U000e0041\r"
)
"""Controls of all kinds, marks of direction, invisible letters, lines, markup."""
NAME = EVIL.replace("/", "-").replace("\x00", "")
"""The same as the name of a file."""


def acting(text):
    """What of a text acts on a terminal: by Unicode's categories, whatever our own table says."""
    kept = text.replace("\r\n", "\n")
    return [
        letter
        for letter in kept
        if letter not in "\n\t" and unicodedata.category(letter) in {"Cc", "Cf", "Zl", "Zp", "Cs"}
    ]


def check(out, err):
    """Nothing acts, no line is faked, and the text itself was shown as it is: markup is no markup."""
    for text in (out, err):
        assert acting(text) == []
        assert not re.search(r"^\s*FAKED", text, re.MULTILINE)


@pytest.fixture
def printed(capsys):
    """Runs a command and returns what it printed."""

    logging = structlog.get_config()

    def call(app, *words):
        capsys.readouterr()
        run(app, [str(word) for word in words])
        out, err = capsys.readouterr()
        check(out, err)
        return out + err

    yield call
    structlog.configure(**logging)


HARMLESS = (*range(0x600, 0x900), 0x110BD, 0x110CD, *range(0x13430, 0x13460), *range(0x1BCA0, 0x1D17B))
"""Of the letters that Unicode calls formats: signs of numbers, joiners of hieroglyphs, of shorthand and of notes."""


def test_every_letter_that_acts_is_spelled():
    for letter in map(chr, {*range(0x20000), *range(0xE0000, 0xE0100)} - set(HARMLESS) | {0x61C}):
        assert not acting(letter) or acting(spelled(letter)) == [], hex(ord(letter))
    assert spelled("a\tb\r\nc \u00e4\u6f22\U0001f600") == "a\tb\r\nc \u00e4\u6f22\U0001f600"
    assert on_one_line("a\tb\r\nc\x1b") == r"a\tb\r\nc\x1b"
    assert on_one_line(EVIL).isprintable()


def test_what_is_printed_is_spelled_and_what_is_drawn_is_not(capsys):
    with guarded_streams(), guarded_streams():
        print(EVIL)
        drawing_stream(sys.stderr).write("\x1b[K")
        sys.stderr.writelines(["a", "\x07"])
    assert capsys.readouterr() == (spelled(EVIL) + "\n", "\x1b[Ka\\x07")
    print("\x1b", end="")
    assert capsys.readouterr().out == "\x1b"


def test_lines_of_the_log_are_lines_of_ours():
    event = {"event": EVIL, "key": EVIL, "exception": "a\nb\x1b", "count": 3}
    line = structlog.dev.ConsoleRenderer(colors=False)(None, "info", spell_values(None, "info", event))
    check(line, "")
    assert "a\nb" in line


@pytest.fixture
def recording(tmp_path):
    """A recording whose every text is evil."""
    path = tmp_path / f"{NAME[:60]}.mcap"
    text = dict.fromkeys(("recorder", "name", "program", "host", "vehicle"), EVIL)
    with path.open("wb") as file:
        writer = RecordingWriter(file, replace(SESSION, **text))
        for number, key in enumerate(("mk/mk1/event/mark", f"mk/{EVIL}/state/attitude", "mk/mk1/state/attitude"), 1):
            stamp = {"monotonic": 1.0, "wall": 2.0, "boot": "a", "synchronised": True}
            payload = msgpack.packb({"stamp": stamp, "text": EVIL, EVIL: EVIL})
            writer.add(sample(number, key)._replace(payload=payload))
        query = sample(4, "mk/mk1/do/lease", kind=EntryKind.QUERY)
        writer.add(query._replace(payload=msgpack.packb({"holder": EVIL}), source=EVIL, exchange=1))
        writer.add(sample(5, "mk/mk1/setpoint/stick", kind=EntryKind.SETPOINT)._replace(source=EVIL))
        refusal = msgpack.packb({"key": "setpoint/stick", "sequence": 5, "token": EVIL})
        writer.add(sample(6, "mk/mk1/notice/setpoint_refused", kind=EntryKind.NOTICE)._replace(payload=refusal))
        writer.finish()
    return path


def test_what_a_recording_says(printed, recording):
    shown = printed(mkctl, "log", "info", recording)
    assert "FAKED" in shown
    assert "[bold red]B[/] :smile:" in shown
    printed(mkctl, "log", "info", recording, "--json")
    printed(mkctl, "log", "verify", recording)
    printed(mkctl, "log", "list", recording.parent)
    printed(mkctl, "log", "repair", recording)
    printed(mkctl, "log", "cut", recording, "-o", recording.with_name(f"{NAME[:50]}.cut"))
    printed(mkctl, "log", "export", recording, "-o", recording.with_name(f"{NAME[:50]}"))
    printed(mkctl, "log", "export", recording, "-f", "gpx", "-o", recording.with_name(f"{NAME[:50]}.gpx"))
    printed(mkdaemon, "replay", "--verify", recording)


@pytest.mark.parametrize(
    ("app", "words", "suffix", "content"),
    [
        (mkdaemon, ("doctor", "--config"), ".toml", '"{}" = 1'),
        (mkdaemon, ("config", "check"), ".toml", '"{}" = 1'),
        (mkdaemon, ("config", "show"), ".toml", 'vehicle.note = "{}"'),
        (mkdaemon, ("security", "show"), ".pem", "{}"),
        (mkctl, ("fly", "--check"), ".toml", '[[step]]\n"{}" = 1\ndo = "land"'),
        (mkctl, ("teleop", "--mapping"), ".toml", '"{}" = 1'),
        (mkctl, ("board", "mixer", "write"), ".toml", 'name = "{}"\n[motors]\n1 = [1, 2, 3, 4]'),
        (mkctl, ("settings", "compare"), ".toml", 'revision = "{}"'),
        (mkctl, ("settings", "compare"), ".json", '{{"{}": 1}}'),
        (mkctl, ("waypoints", "verify"), ".csv", "latitude,longitude,altitude,{}\n1,2,{},4"),
        (mkctl, ("waypoints", "verify"), ".wpl", "[{}]\n{}"),
        (mkctl, ("waypoints", "verify"), ".gpx", '<gpx><wpt lat="{}" lon="2"/></gpx>'),
        (mkctl, ("waypoints", "verify"), ".plan", '{{"fileType": "{}"}}'),
        (mkctl, ("status", "--zenoh-file"), ".json5", '{{"{}": 1}}'),
        (mkctl, ("log", "verify"), ".mcap", "{}"),
        (mkdaemon, ("decode",), ".jsonl", '{{"t": "{}"}}'),
        (mkdaemon, ("detect",), ".png", "{}"),
        (mkdaemon, ("calibrate", "print", "out.svg", "--target"), ".toml", '[[targets]]\nname = "{}"\n"{}" = 2'),
        (mkdaemon, ("calibrate", "camera", "-o", "camera.toml"), ".png", "{}"),
    ],
)
@pytest.mark.parametrize("as_escapes", [False, True])
def test_what_files_and_their_names_say(printed, tmp_path, monkeypatch, app, words, suffix, content, as_escapes):
    monkeypatch.chdir(tmp_path)
    text = "".join(f"\\u{ord(letter):04x}" for letter in EVIL if ord(letter) < 0x10000) if as_escapes else EVIL
    path = tmp_path / f"{NAME[:60]}{suffix}"
    path.write_text(content.replace("{}", text).replace("{{", "{").replace("}}", "}"), encoding="utf-8", newline="")
    printed(app, *words, path)
    printed(app, *words, path.with_name(f"absent{NAME[:60]}{suffix}"))


def test_words_of_the_command_line(printed):
    printed(mkctl, NAME)
    printed(mkctl, "log", NAME)
    printed(mkdaemon, f"--{NAME}")
    printed(mkctl, "log", "info", "--from", NAME)


async def test_what_a_daemon_and_strangers_put_on_the_bus(capsys):
    async with fake_daemon() as daemon:
        daemon.bus.publish("event/log", LogEvent(stamp=CLOCK.stamp(), level=EVIL, text=EVIL))
        here = ["--vehicle", VEHICLE, "--connect", daemon.endpoint]
        daemon.replies |= {"do/mark": dict}
        for words in (
            ["get", "event/log"],
            ["get", "event/log", "--lines"],
            ["get", "event/log", "--json"],
            ["log", "mark", NAME],
        ):
            await asyncio.to_thread(run, mkctl, [*words, *here])
            out, err = capsys.readouterr()
            check(out, err)
            assert "FAKED" in out
        for words in (["watch", "event/log", "-n", "1"], ["watch", "event/log", "-n", "1", "--lines"]):
            watching = asyncio.create_task(asyncio.to_thread(run, mkctl, [*words, *here]))
            while not watching.done():
                daemon.bus.publish("event/log", LogEvent(stamp=CLOCK.stamp(), level=EVIL, text=EVIL))
                await asyncio.sleep(0.05)
            out, err = capsys.readouterr()
            check(out, err)
            assert "FAKED" in out
