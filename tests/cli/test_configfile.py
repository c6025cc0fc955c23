"""`mkdaemon config`: check, show, explain and begin a file."""

from __future__ import annotations

import json
from functools import partial

import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.config.keys import keys_of
from mkdaemon.config.reader import load
from mkdaemon.config.root import DaemonSections
from tests.places import CONFIGS


@pytest.fixture
def config(typed):
    return partial(typed, app, "config")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "vehicle.toml"


def test_a_new_file_is_right_and_says_the_defaults(config, path):
    code, out, _ = config("new", path, "--vehicle", "mk7", "--port", "tcp:host:1")
    assert code == 0
    assert f"mkdaemon config check {path}" in out
    cfg = load(path)
    assert (cfg.vehicle.name, cfg.link.port, cfg.link.baud) == ("mk7", "tcp:host:1", 57600)
    assert config("check", path)[:2] == (0, f"{path}: no mistake; 2 keys are set, all others have their defaults\n")
    assert "already exists" in config("new", path)[2]
    assert config("new", path, "--force")[0] == 0


def test_a_new_file_with_all_keys_is_right_when_every_comment_is_taken_away(config, path):
    _, out, _ = config("new", "--all")
    keys = list(keys_of(DaemonSections))
    bare = [line.removeprefix("# ") for line in out.splitlines()]
    assert [key.dotted for key in keys if not any(line.startswith(f"{key.name} = ") for line in bare)] == []
    path.write_text(out, encoding="utf-8")
    assert load(path) == load(None)
    names = {key.name for key in keys}
    lines = [line for line in bare if line.startswith("[") or (line.partition(" = ")[0] in names and "..." not in line)]
    path.write_text("\n".join(lines).replace("[[cameras]]", '[[cameras]]\nsource = "/dev/video0"'), encoding="utf-8")
    cfg = load(path)
    assert cfg.model_copy(update={"cameras": (), "positions": ()}) == load(None)
    assert cfg.positions[0].trusted_for == ("takeoff", "flight", "landing")
    assert cfg.cameras[0].fps is None


def test_every_mistake_is_told(config, path):
    path.write_text('[link]\nport = "ttyUSB0"\nrates = { osf = 100 }\n', encoding="utf-8")
    code, out, _ = config("check", path)
    assert (code, len(out.splitlines())) == (2, 2)
    code, out, _ = config("check", path, "--port", "tcp:h:1", "--json")
    line = json.loads(out)
    assert (code, line["is_valid"], len(line["mistakes"])) == (2, False, 1)
    path.write_text('[link]\nbaud = "x"\nprot = 1\n[vehicle]\nnaem = 2\n', encoding="utf-8")
    lines = config("check", path)[1].splitlines()
    assert [line.split(": ")[1] for line in lines] == ["vehicle.naem", "link.prot", "link.baud"]
    path.write_text("[lnk]\n", encoding="utf-8")
    code, out, _ = config("check", path)
    assert (code, out) == (2, f'{path}:1: lnk: unknown key; did you mean "link"?\n')


@pytest.mark.parametrize("sample", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_what_is_delivered_passes(config, sample):
    code, out, _ = config("check", sample)
    assert (code, "no mistake" in out) == (0, True)
    assert ("name it with --port" in out) is (not load(sample).link.port)


def test_what_is_shown_is_a_file_again_and_says_where_each_value_comes_from(config, path, monkeypatch):
    monkeypatch.setenv("MKDAEMON_LINK__BAUD", "19200")
    monkeypatch.chdir(CONFIGS.parent)
    sample = CONFIGS / "cyberquad.toml"
    _, out, _ = config("show", sample, "--port", "tcp:h:1")
    assert any(
        line.split() == ["baud", "=", "19200", "#", "environment", "MKDAEMON_LINK__BAUD"] for line in out.splitlines()
    )
    assert '"tcp:h:1"' in out
    assert "# command line" in out
    assert f"# {sample}:9" in out
    path.write_text(out, encoding="utf-8")
    monkeypatch.delenv("MKDAEMON_LINK__BAUD")
    assert load(path) == load(sample, {"link.port": "tcp:h:1", "link.baud": 19200})


def test_cameras_are_shown_as_tables_of_a_list(config, path):
    text = '[[cameras]]\nsource = "a"\n[cameras.mount]\nlooks = "up"\n[[cameras]]\nname = "b"\nsource = "c"\n'
    path.write_text(text, encoding="utf-8")
    _, out, _ = config("show", path, "--changed")
    again = path.with_name("again.toml")
    again.write_text(out, encoding="utf-8")
    assert load(again) == load(path)
    lines = [json.loads(line) for line in config("show", path, "--changed", "--json")[1].splitlines()]
    assert {"key": "cameras.1.name", "value": "b", "origin": f"{path}:6"} in lines


def test_a_key_is_explained_with_all_that_is_known_of_it(config):
    _, out, _ = config("explain", "link.gap_ms")
    for words in (
        "Idle line",
        "unit            ms",
        "12.0",
        ">= 2.25, <= 100",
        "loses the next frame",
        "needs a restart",
    ):
        assert words in out
    assert "MKDAEMON_LINK__GAP_MS" in out
    assert "taken up by a running daemon" in config("explain", "vehicle.note")[1]
    assert "MKDAEMON" not in config("explain", "cameras.source")[1]
    line = json.loads(config("explain", "rate", "--json")[1])
    assert (line["key"], line["unit"]) == ("control.rate", "Hz")


def test_sections_are_listed(config):
    _, out, _ = config("explain")
    assert "[[cameras]]" in out
    assert "[control.autopilot]" in out
    assert config("explain", "control.lease")[1].startswith("ttl ")
    code, _, err = config("explain", "link.gapms")
    assert code == 2
    assert "did you mean link.gap_ms" in err
