"""Layers of a configuration: what goes before what, how mistakes are named, and what a running daemon takes up."""

from __future__ import annotations

import pytest

from mkdaemon.config.keys import keys_of
from mkdaemon.config.layers import find_key, load_layers, values_of
from mkdaemon.config.reader import load
from mkdaemon.config.reload import plan_reload
from mkdaemon.config.root import DaemonSections
from mkdaemon.errors import ConfigError

FILE = """[link]
port = "/dev/ttyUSB0"
baud = 19200

[[cameras]]
source = "/dev/video0"
[control.limiter]
slew = 500.0
"""


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "x.toml"
    file.write_text(FILE, encoding="utf-8")
    return file


def test_each_layer_goes_before_the_one_below(path):
    environment = {"MKDAEMON_LINK__PORT": "/dev/ttyUSB1", "MKDAEMON_LINK__BAUD": "38400", "HOME": "/"}
    layered = load_layers(path, {"link.port": "/dev/ttyUSB2"}, environment)
    assert (layered.cfg.link.port, layered.cfg.link.baud) == ("/dev/ttyUSB2", 38400)
    assert layered.cfg.control.limiter.slew == 500.0
    assert layered.origin("link.port") == "command line"
    assert layered.origin("link.baud") == "environment MKDAEMON_LINK__BAUD"
    assert layered.origin("control.limiter.slew") == f"{path}:8"
    assert layered.origin("cameras.0.source") == f"{path}:6"
    assert layered.origin("link.gap_ms") == "default"


@pytest.mark.parametrize(
    ("variable", "text", "key", "value"),
    [
        ("MKDAEMON_BUS__LISTEN", '["tcp/127.0.0.1:1"]', "bus.listen", ("tcp/127.0.0.1:1",)),
        ("MKDAEMON_CONTROL__GUARD", "false", "control.guard", False),
        ("MKDAEMON_LINK__RATES", "{ osd = 100 }", "link.rates", {"osd": 100.0}),
        ("MKDAEMON_LINK__RATES", "off", "link.rates", "off"),
        ("MKDAEMON_VEHICLE__NAME", "7", "vehicle.name", "7"),
        ("MK_VEHICLE", "mk9", "vehicle.name", "mk9"),
    ],
)
def test_values_of_the_environment(variable, text, key, value):
    layered = load_layers(None, {}, {variable: text})
    found = {f"{each.section}.{each.name}": each for each in values_of(layered)}[key]
    assert (found.value, found.origin) == (value, f"environment {variable}")


def test_the_clients_name_counts_without_a_file_alone(path):
    assert load_layers(path, {}, {"MK_VEHICLE": "mk9"}).cfg.vehicle.name == "mk1"
    both = {"MK_VEHICLE": "mk9", "MKDAEMON_VEHICLE__NAME": "mk8"}
    assert load_layers(None, {}, both).cfg.vehicle.name == "mk8"


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"MKDAEMON_LINK__BUAD": "1"}, r"environment MKDAEMON_LINK__BUAD: link\.buad: .*did you mean link\.baud"),
        ({"MKDAEMON_PORT": "x"}, r"environment MKDAEMON_PORT: port is no single key"),
        ({"MKDAEMON_CAMERAS__SOURCE": "x"}, "write it into the file"),
        ({"MKDAEMON_LINK__BAUD": "fast"}, r"environment MKDAEMON_LINK__BAUD: link\.baud: a whole number is needed"),
        ({"MKDAEMON_LINK__BAUD": "9"}, r"environment MKDAEMON_LINK__BAUD: link\.baud: must be at least 1200 baud"),
        ({"MKDAEMON_LINK__BAUD": "1\nx = 2"}, "environment MKDAEMON_LINK__BAUD: .*whole number"),
    ],
)
def test_a_mistake_of_the_environment_names_the_variable(environment, words):
    with pytest.raises(ConfigError, match=words):
        load_layers(None, {}, environment)


def test_every_value_is_shown_once(path):
    values = [f"{value.section}.{value.name}" for value in values_of(load_layers(path, {}, {}))]
    assert len(values) == len(set(values))
    every = {key.dotted for key in keys_of(DaemonSections) if not key.dotted.startswith("positions.")}
    wanted = {dotted.replace("cameras.", "cameras.0.") for dotted in every}
    assert wanted - set(values) == {f"cameras.0.mount.{name}" for name in ("position_flu", "looks", "rpy_deg")}


def test_a_key_is_found_by_its_own_name_where_there_is_one_of_it():
    assert find_key("gap_ms").dotted == "link.gap_ms"
    with pytest.raises(ConfigError, match=r"neutral_band: no such key; did you mean control\.lease\.neutral_band or"):
        find_key("neutral_band")
    with pytest.raises(ConfigError, match="lists all"):
        find_key("zzzzzzzzzzzz")


def test_what_can_be_taken_up_is_and_the_rest_is_named():
    running = load(None, {"link.port": "tcp:h:1"})
    wanted = load(
        None,
        {
            "link.port": "tcp:h:2",
            "vehicle.note": "new battery",
            "commands.allow_reset": True,
            "record.images.hz": 5.0,
            "control.limiter.max_pitch": 10,
            "cameras": [{"source": "/dev/video0"}],
            "sim": {"board": "fc"},
        },
    )
    plan = plan_reload(running, wanted)
    assert plan.taken == ("vehicle.note", "commands.allow_reset", "record.images.hz")
    assert plan.waiting == ("link.port", "control.limiter.max_pitch", "cameras")
    assert (plan.cfg.vehicle.note, plan.cfg.commands.allow_reset, plan.cfg.record.images.hz) == (
        "new battery",
        True,
        5.0,
    )
    assert (plan.cfg.link, plan.cfg.control, plan.cfg.cameras) == (running.link, running.control, ())


def test_nothing_differs_from_itself():
    plan = plan_reload(load(None), load(None))
    assert (plan.taken, plan.waiting, plan.cfg) == ((), (), load(None))
