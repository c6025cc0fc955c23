"""Files of strangers: whatever is in them, every reader says in one line what is wrong, soon, and goes no further."""

from __future__ import annotations

import ast
import json
import os
import struct
import tomllib
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from lab.files.originals import Kind, originals
from mkdaemon import foreignfiles
from mkdaemon.bus.session import session_config
from mkdaemon.cli.mkctl.mixer import from_toml
from mkdaemon.cli.mkctl.teleop.padrecording import read_recording as read_pad
from mkdaemon.cli.mkdaemon.app import app as mkdaemon
from mkdaemon.cli.program import run
from mkdaemon.client.linktest.probefile import read_csv as read_probes
from mkdaemon.client.settings_files import read_sets
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load, load_section
from mkdaemon.daemon.guard import take_report
from mkdaemon.errors import ConfigError, MkError, VisionError
from mkdaemon.foreignfiles import DEEPEST, open_regular, parse_json, parse_toml, read_text
from mkdaemon.link.labels import LabelCache
from mkdaemon.link.ports.replayport import read_recording
from mkdaemon.missions import read_mission
from mkdaemon.missions.pathcsv import read_pieces
from mkdaemon.missions.script import read_script
from mkdaemon.record.reader import Recording
from mkdaemon.record.summary import glance
from mkdaemon.vision.calibrate.views import Views
from mkdaemon.vision.camera.calibration_file import load_camera
from mkdaemon.vision.camera.image import PictureError
from mkdaemon.vision.camera.imagecodec import decode_picture, picture_size, read_picture
from mkdaemon.vision.tags.targetfile import load as load_targets
from tests.effort import calls_of

DIGITS = "7" * 5000
CONTENTS = {
    "empty": b"",
    "nul": b"\0" * 100,
    "latin-1": "Höhe = 'ä'".encode("latin-1"),
    "utf-16": "a = 1\n".encode("utf-16"),
    "deep json": b"[" * 100_000,
    "deep json table": b'{"fileType":"Plan","a":' * 5000,
    "deep toml": b"a = " + b"[" * 100_000,
    "deep toml keys": b".".join([b"a"] * 1200) + b" = 1",
    "digits toml": f"a = {DIGITS}".encode(),
    "digits json": f'{{"t": {DIGITS}, "dir": "rx", "hex": ""}}'.encode(),
    "huge json number": f'{{"t": 1{"0" * 400}, "dir": "rx", "hex": "00"}}'.encode(),
    "digits csv": f"latitude,longitude,altitude\n{DIGITS},{DIGITS},1\n".encode(),
    "long csv field": b"latitude,longitude,altitude,name\n1,2,3," + b"x" * 200_000 + b"\n",
    "long quoted csv field": b'latitude,longitude,altitude\n"' + b"x" * 3_000_000,
    "digits wpl": f"[General]\nFileVersion=3\nNumberOfWaypoints={DIGITS}\n".encode(),
    "many wpl points": b"[General]\nFileVersion=3\nNumberOfWaypoints=1000000000000\n",
    "one long line": b"x" * 8_000_000,
    "one long capture line": b'{"t": 1.0, "dir": "rx", "hex": "' + b"00" * 4_000_000,
    "deep xml": b"<a>" * 100_000,
    "entities": b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>',
    "cut-off png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
}


def png(width, height):
    """A PNG that says so of itself, with one line of pixels."""

    def chunk(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = zlib.compress(bytes(1 + width))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


class NoBoard:
    """A calibration board that is in no picture."""

    def find(self, pixels):
        return None


def views(path):
    return list(Views(NoBoard()).take_folder(path.parent))


READERS = {
    "settings.toml": lambda path: load(path),
    "mixer.toml": from_toml,
    "set.toml": read_sets,
    "set.json": read_sets,
    "camera.toml": load_camera,
    "targets.toml": lambda path: load_targets([path]),
    "tags.yaml": lambda path: load_targets([path]),
    "field.json": lambda path: load_targets([path]),
    "capture.jsonl": read_recording,
    "labels.json": LabelCache,
    "recording.mcap": lambda path: list(Recording(path).entries()),
    "glance.mcap": glance,
    "script.toml": read_script,
    "path.csv": read_pieces,
    "pad.jsonl": read_pad,
    "report.json": take_report,
    "zenoh.json5": lambda path: session_config("peer", zenoh_file=path),
    "picture.png": read_picture,
    "view.png": views,
    "linktest.csv": read_probes,
    "ost.yaml": load_camera,
    "ost.txt": load_camera,
    "route.kmz": read_mission,
    "route.waypoints": read_mission,
    **{f"route{suffix}": read_mission for suffix in (".gpx", ".kml", ".plan", ".csv", ".wpl")},
}


ORIGINALS = {
    "settings.toml": Kind.CONFIG,
    "mixer.toml": Kind.MIXER,
    "set.toml": Kind.SETTINGS_TOML,
    "set.json": Kind.SETTINGS_JSON,
    "camera.toml": Kind.CAMERA,
    "targets.toml": Kind.TARGET,
    "capture.jsonl": Kind.CAPTURE,
    "script.toml": Kind.SCRIPT,
    "pad.jsonl": Kind.PAD_SESSION,
    "zenoh.json5": Kind.ZENOH,
    "linktest.csv": Kind.PROBES,
    **{f"route{kind}": kind for kind in (Kind.GPX, Kind.KML, Kind.PLAN, Kind.CSV, Kind.WPL)},
}
"""A good text file for each reader of text; what `labels.json` and `report.json` hold only this program writes."""
OWN = {
    "cli/storedhelp",
    "cli/mkdaemon/service/installing",
    "cli/mkdaemon/service/units",
    "clock",
    "gateways/mavlink/signing",
    "link/ports/serialport",
    "view/page/server",
    "view/report/page",
}
"""Modules that read what this program or the kernel wrote, without `mkdaemon.foreignfiles`."""


def test_no_module_opens_files_of_others_in_another_way():
    source, reads = Path(foreignfiles.__file__).parent, set()
    for path in source.rglob("*.py"):
        calls = (node.func for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call))
        if any(isinstance(call, ast.Attribute) and call.attr in {"read_text", "read_bytes"} for call in calls):
            reads.add(str(path.relative_to(source).with_suffix("")))
    assert reads - {"foreignfiles"} == OWN


@pytest.mark.parametrize("name", ORIGINALS)
def test_a_byte_order_mark_changes_nothing(tmp_path, name):
    path = tmp_path / name
    for content in originals(ORIGINALS[name]):
        found = []
        for mark, end in ((b"", b"\n"), (b"\xef\xbb\xbf", b"\r\n")):
            path.write_bytes(mark + content.replace(b"\n", end))
            found.append(repr(READERS[name](path)))
        assert found[0] == found[1]
    assert parse_json(b'\xef\xbb\xbf{"a": 1}') == {"a": 1}


def read(name, path):
    """What a reader made of a file: it may only fail as ours, or as the system does."""
    try:
        READERS[name](path)
    except (MkError, VisionError):
        pass
    except OSError as error:
        assert error.strerror


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with a file of each content: the long ones are written once."""
    folder = tmp_path_factory.mktemp("contents")
    for kind, content in CONTENTS.items():
        (folder / kind).write_bytes(content)
    return folder


@pytest.mark.parametrize("name", READERS)
def test_whatever_is_in_a_file_its_reader_says_so(tmp_path, written, name):
    for kind in CONTENTS:
        path = tmp_path / kind / name
        path.parent.mkdir()
        os.link(written / kind, path)
        read(name, path)


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir], ids=["fifo", "folder"])
def test_what_is_no_file_is_not_waited_for(tmp_path, name, make):
    path = tmp_path / name
    make(path)
    read(name, path)


def test_a_huge_picture_is_refused_by_its_header(monkeypatch):
    assert decode_picture(png(32, 1)).shape == (1, 32)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(PictureError, match="no picture that can be read"):
        decode_picture(png(32_000, 32_000))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".pgm"])
def test_the_size_in_the_header_is_that_of_the_picture(suffix):
    _, coded = cv2.imencode(suffix, np.zeros((48, 70), dtype=np.uint8))
    content = coded.tobytes()
    assert picture_size(content) == (70, 48)
    assert decode_picture(content).shape == (48, 70)
    assert all(picture_size(content[:length]) in (None, (70, 48)) for length in range(len(content)))


@pytest.mark.parametrize(
    ("parse", "error", "opening", "closing"),
    [(parse_json, json.JSONDecodeError, "", ""), (parse_toml, tomllib.TOMLDecodeError, "a = ", "")],
)
def test_nesting_has_a_limit(parse, error, opening, closing):
    depth = DEEPEST - 2
    parse(opening + "[" * depth + "]" * depth + closing)
    for too_deep in (DEEPEST + 1, 500, 100_000):
        with pytest.raises(error, match="deeper"):
            parse(opening + "[" * too_deep + "]" * too_deep + closing)


@pytest.mark.parametrize("text", ["{} = 1", "[{}]", "[[{}]]", "a = {{ {} = 1 }}"])
@pytest.mark.parametrize("part", ["a", '"a b"', "'a'"])
def test_a_dotted_key_nests_as_deep_as_it_has_parts(text, part):
    assert parse_toml(text.format(" . ".join([part] * 20)))

    def read() -> None:
        with pytest.raises(tomllib.TOMLDecodeError, match="nests deeper"):
            parse_toml(text.format(".".join([part] * 50_000)))

    assert calls_of(read) < 1000


def test_a_file_may_not_be_longer_than_allowed(tmp_path):
    path = tmp_path / "long"
    path.write_bytes(bytes(1001))
    with pytest.raises(OSError, match="larger"):
        open_regular(path, 1000)
    assert read_text(path, limit=1001) == "\0" * 1001


@pytest.mark.parametrize(
    "read",
    [
        load,
        lambda path: load_section(Gamepad, path),
        load_camera,
        lambda path: load_targets([path]),
        read_script,
        from_toml,
        read_sets,
    ],
    ids=["configuration", "gamepad", "camera", "targets", "script", "mixer", "settings"],
)
def test_a_file_of_settings_has_a_length_of_its_own(tmp_path, read):
    path = tmp_path / "long.toml"
    path.write_text("".join(f"k{number} = 1\n" for number in range(100_000)))

    def refused() -> None:
        with pytest.raises(ConfigError, match=r"larger than 0.5 MB"):
            read(path)

    assert calls_of(refused) < 1000


@pytest.mark.parametrize(
    ("suffix", "head", "point", "tail"),
    [
        (".csv", "latitude,longitude,altitude\n", "1,2,3\n", ""),
        (".gpx", "<gpx>", "<wpt lat='1' lon='2'/>", "</gpx>"),
        (".kml", "<kml>", "<Placemark><Point/></Placemark>", "</kml>"),
        (".kml", "<kml><LineString><coordinates>", "1,2 ", "</coordinates></LineString></kml>"),
        (".plan", '{"fileType": "Plan", "mission": {"items": [0', ",{}", "]}}"),
        (".wpl", "[General]\nFileVersion=3\nNumberOfWaypoints=30000\n", "", ""),
    ],
    ids=["csv", "gpx", "kml points", "kml path", "plan", "wpl"],
)
def test_a_mission_of_too_many_points_is_refused_for_no_more_than_its_length(tmp_path, suffix, head, point, tail):
    path = tmp_path / f"long{suffix}"

    def refused() -> None:
        with pytest.raises(ConfigError, match="more than 2000 points"):
            read_mission(path)

    calls = []
    for points in (2500, 10_000):
        path.write_text(head + point * points + tail)
        calls.append(calls_of(refused))
    assert calls[1] < 5 * calls[0] < 5 * 200_000


def test_a_file_that_fails_while_it_is_read_is_named(capsys):
    assert run(mkdaemon, ["decode", "/proc/self/mem"]) == 1
    assert capsys.readouterr().err == "mkdaemon: /proc/self/mem: Input/output error\n"
    print("goes on")
    assert capsys.readouterr().out == "goes on\n"
