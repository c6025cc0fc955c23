"""A genuine NaviCtrl in the proving ground, without its firmware: sources, its GPS receiver, what it says.

The firmware is the user's (docs/lab/genuine-navictrl.md), so nothing here runs one.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from lab.hil import build as building
from lab.hil import pair
from lab.hil.build import files_of, narrowed
from lab.hil.build import main as make
from lab.hil.main import main
from lab.hil.naviboard import NaviLines, report
from mkdaemon.errors import ConfigError
from mksim.physics.sensors import GpsReport

STUB = Path(building.__file__).with_name("navictrl.c")


def test_without_a_navictrl_it_says_what_to_fetch_and_to_run(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "NAVICTRL", tmp_path)
    with pytest.raises(ConfigError, match=r"zakwiggy/navictrl(.|\n)*make hil NAVICTRL="):
        main(case="pair")


def test_make_says_how_it_is_called_and_names_a_folder_without_sources(tmp_path, capsys):
    assert make(["", "", ""]) == make(["fc", "", ""]) == 2
    assert "make hil NAVICTRL=<folder" in capsys.readouterr().err
    assert make(["", "", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith(f"error: {tmp_path}: no sources of a NaviCtrl")


@pytest.fixture
def sources(tmp_path):
    (tmp_path / "main.h").touch()
    (tmp_path / "makefile").write_text(
        "SRCARM = ./lib/src/x.c\nSRCARM += main.c\nSRCARM += ramfunc.c\nSRCARM += gps.c\n"
    )
    return tmp_path


def test_what_does_not_compile_is_named_with_the_release_that_does(sources, monkeypatch):
    monkeypatch.setattr(building, "NAVICTRL", sources / "build")
    (sources / "main.c").write_text("#error of another time\n")
    with pytest.raises(ConfigError, match=r"NaviCtrl .* \(0\.24b is known to build\): main\.c") as raised:
        building.build_navictrl(sources)
    assert "of another time" in str(raised.value)


def test_files_are_those_of_the_makefile_without_what_only_the_processor_needs(sources):
    assert [path.name for path in files_of(sources)] == ["main.c", "gps.c"]


def test_long_has_32_bits_as_on_the_board():
    assert narrowed(b"unsigned long a; signed long *b;") == b"unsigned int a; signed int *b;"
    assert narrowed(b"typedef long long u64; long belongs; along") == b"typedef long long u64; int belongs; along"


def test_the_stub_and_python_lay_the_boards_edge_out_alike():
    found = re.search(r"struct lines \{(.*?)\};", STUB.read_text(), re.DOTALL)
    assert re.findall(r"int16_t (\w+)", found.group(1)) == [name for name, _ in NaviLines._fields_]


def test_a_report_of_the_gps_receiver():
    fix = GpsReport(532301089, -74590625, 42.5, (1.0, -2.0, 0.5), 9, True, 0.2, 3)
    said = report(fix)
    lengths = []
    while said:
        assert said[:3] == b"\xb5\x62\x01"
        size = int.from_bytes(said[4:6], "little")
        first = second = 0
        for byte in said[2 : 6 + size]:
            first = (first + byte) & 0xFF
            second = (second + first) & 0xFF
        assert tuple(said[6 + size : 8 + size]) == (first, second)
        lengths.append((said[3], size))
        if said[3] == 0x02:
            assert int.from_bytes(said[10:14], "little", signed=True) == -74590625
        said = said[8 + size :]
    assert lengths == [(0x06, 52), (0x02, 28), (0x12, 36)]


def test_a_flight_of_the_pair_that_is_lost_fails(capsys):
    row = {"seed": 7, "hold_cm": 3.5, "lost": [], "warnings": []}
    assert pair.show([row], as_json=True) == 0
    assert pair.show([row, row | {"lost": ["it did not land"]}], as_json=True) == 1
    assert pair.show([{"seed": 7, "ending": "failed", "why": "no memory"}], as_json=True) == 1
    shown = capsys.readouterr().out.splitlines()
    assert json.loads(shown[0])["rows"] == [{"seed": 7, "hold_cm": 3.5, "lost": [], "holds": True}]
