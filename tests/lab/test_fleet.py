"""Many aircraft: the lossy link, what a cut must show, what is counted, and the refusals of the command."""

from __future__ import annotations

import json
import re
import signal
import tomllib

import msgpack
import pytest

from lab.fleet.cut import claims, longest_gap
from lab.fleet.main import counts_of, keep, main
from lab.fleet.members import Member, vehicle_config
from lab.fleet.network import DelayLine
from lab.fleet.scale import Counted
from mkdaemon.bus.session import check_endpoint
from mkdaemon.config.root import Config
from mkdaemon.errors import ConfigError
from mkdaemon.record.countcheck import COUNTS
from tests.places import ROOT

REFUSED = "the router at tcp/1.2.3.4:7447 does not reach vehicle mk2: its link is cut"


def test_packets_come_later_and_in_order():
    line = DelayLine(1, loss=0.0)
    line.put(b"a", 1.0)
    line.put(b"bc", 1.01)
    assert line.next_time() == pytest.approx(1.03)
    assert line.due(1.02) == []
    assert line.due(1.05) == [b"a", b"bc"]
    assert line.next_time() is None


def test_the_declared_share_of_packets_is_lost_and_the_same_ones_each_time():
    def passed(seed):
        line = DelayLine(seed)
        for number in range(10_000):
            line.put(number.to_bytes(2, "big"), 0.0)
        return line.due(1.0)

    assert len(passed(1)) == pytest.approx(9500, abs=100)
    assert passed(1) == passed(1) != passed(2)


def test_a_cut_loses_what_comes_and_what_is_under_way():
    line = DelayLine(1, loss=0.0)
    line.put(b"under way", 1.0)
    line.is_cut = True
    line.put(b"later", 1.0)
    assert line.due(2.0) == []
    line.is_cut = False
    line.put(b"again", 2.0)
    assert line.due(2.03) == [b"again"]


@pytest.mark.parametrize(
    ("times", "gap"), [([], 10.0), ([1.0, 9.0], 8.0), ([0.5 * n for n in range(21)], 0.5), ([-5.0, 20.0], 10.0)]
)
def test_a_gap_counts_from_the_edges(times, gap):
    assert longest_gap(times, 0.0, 10.0) == gap


def refusal(took, words=REFUSED, **more):
    return {"asked": "status", "took": took, "words": words, "is_refused": True, "is_program": False} | more


RIGHT = {
    "cut_for": 12.0,
    "told_stale": 3.1,
    "told_gone": 2.1,
    "told_back": 1.7,
    "fresh": 1.8,
    "leased_again": 2.5,
    "others": ["here"],
    "others_gap": 0.2,
    "others_lost": 0,
    "refusals": [refusal(1.7), refusal(9.0, is_program=True)],
    "last_setpoint": 0.03,
    "released": 1.0,
    "client_told": 3.0,
    "aboard_gap": 0.2,
    "aboard": 80,
    "ground_gap": 12.9,
    "ground_lost": 700,
    "exit_codes": [0, 0, 0],
}
"""What a right cut shows."""


@pytest.mark.parametrize(
    "wrong",
    [
        {"told_stale": None, "told_gone": 5.0},
        {"told_gone": None},
        {"others": ["here", "stale"]},
        {"others_gap": 2.5},
        {"others_lost": 1},
        {"refusals": []},
        {"refusals": [refusal(9.0)]},
        {"refusals": [refusal(1.0, "no daemon")]},
        {"refusals": [refusal(1.0, f"{REFUSED}\nmore")]},
        {"refusals": [refusal(1.0, is_refused=False)]},
        {"released": None},
        {"released": 0.4},
        {"released": 2.5},
        {"client_told": None},
        {"fresh": 30.0},
        {"told_back": None},
        {"leased_again": None},
        {"aboard": 0},
        {"aboard_gap": 12.0},
        {"ground_gap": 3.0},
        {"ground_lost": 0},
        {"exit_codes": [0, -9, 0]},
    ],
)
def test_whatever_a_cut_must_show_and_does_not_is_no_success(wrong):
    assert all(claims(RIGHT).values())
    assert not all(claims(RIGHT | wrong).values())


def test_values_are_counted_by_group_with_losses_lateness_and_frames():
    counted = Counted()
    for second in range(3):
        for number in range(4):
            if (second, number) != (1, 2):  # one is lost
                payload = msgpack.packb({"stamp": {"wall": 100.0 + second}})
                counted.take("mk/mk1/state/attitude", payload, 100.0 + second + 0.002)
        traffic = {"rx_frames": 50 * second, "dropped": {"checksum": 2 * second}}
        counted.take("mk/mk1/link/traffic", msgpack.packb(traffic), 0.0)
        counts = {"counts": {"state/attitude": 4 * (second + 1)}}
        counted.take(f"mk/mk1/{COUNTS}", msgpack.packb(counts), 0.0)
    row = counted.figures(1, 3.0)
    assert (row["lost_percent"], row["line_lost"]) == (pytest.approx(100 / 18, abs=0.01), 4)
    assert row["late_p50_ms"] == pytest.approx(2.0, abs=0.01)
    assert row["values_per_s"] == pytest.approx(17 / 3, abs=0.1)
    assert set(row["groups_kb_per_s_each"]) == {"state", "link", "bus"}


def test_the_file_of_a_vehicle_behind_a_router_is_a_right_configuration(tmp_path):
    text = vehicle_config("mk2", tmp_path, 4001, "tcp/10.77.2.1:7447", [])
    cfg = Config.model_validate(tomllib.loads(text))
    assert (cfg.vehicle.name, cfg.bus.listen, cfg.bus.connect) == ("mk2", (), ("tcp/10.77.2.1:7447",))


def test_the_files_on_the_page_about_fleets_are_right_configurations():
    page = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
    files = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)]
    read = [Config.model_validate(file) for file in files]
    assert [cfg.vehicle.name for cfg in read] == ["mk2", "mk3", "mk2"]
    assert [cfg.bus.connect for cfg in read] == 2 * [("tcp/10.77.0.1:7447",)] + [("tls/10.77.0.1:7447",)]
    for endpoint in (one for cfg in read for one in (*cfg.bus.connect, *cfg.bus.listen)):
        check_endpoint(endpoint, "docs/fleet.md")


@pytest.mark.parametrize("words", ["", "0", "1,x", "-3", "1,,2"])
def test_numbers_of_aircraft_that_cannot_be_are_named(words):
    with pytest.raises(ConfigError, match="--vehicles"):
        counts_of(words)
    assert counts_of("1, 5,10") == [1, 5, 10]


def test_without_the_right_to_namespaces_it_says_so_in_one_line(monkeypatch):
    class Refusing:
        def unshare(self, _flags):
            return -1

    monkeypatch.setattr("lab.fleet.network.ctypes.CDLL", lambda *_, **__: Refusing())
    monkeypatch.setattr("lab.fleet.network.ctypes.get_errno", lambda: 1)
    monkeypatch.setattr("lab.fleet.network.shutil.which", lambda name: name)
    with pytest.raises(ConfigError, match=r"no network namespaces here \(Operation not permitted\): run it as root"):
        main(case="cut")


def test_a_result_takes_the_place_of_the_one_of_its_case(tmp_path):
    path = tmp_path / "fleet.json"
    for case, row in (("cut", {"a": 1}), ("scale", {"b": 2}), ("cut", {"a": 3})):
        keep(path, case, row)
    assert json.loads(path.read_text(encoding="utf-8")) == {"cut": {"a": 3}, "scale": {"b": 2}}


async def test_a_program_says_what_it_used_and_how_it_ended():
    program = await Member.start("-c", "import time; print('here', flush=True); time.sleep(60)")
    assert await program.first_line() == "here"
    assert program.cpu_s() >= 0.0
    assert program.own_mb() > 1.0
    assert await program.end() == -signal.SIGTERM
    assert await (await Member.start("-c", "print('well'); raise SystemExit(3)")).output() == (3, "well\n")
