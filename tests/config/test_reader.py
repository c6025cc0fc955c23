"""Configuration files and their layers: what is read, what goes before what, and how mistakes are named."""

from __future__ import annotations

import pytest

from mkdaemon.config.layers import find_key, load_layers, values_of
from mkdaemon.config.reader import load
from mkdaemon.config.reload import plan_reload
from mkdaemon.errors import ConfigError
from tests.places import CONFIGS

MISTAKES = [
    ('[link]\nbaud = 57600\nprot = "x"\n', r'x\.toml:3: link\.prot: unknown key; did you mean "port"\?'),
    ("[limk]\nbaud = 1\n", r'x\.toml:1: limk: unknown key; did you mean "link"\?'),
    ("[control.limiter]\n\nmax_pich = 1\n", r'x\.toml:3: control\.limiter\.max_pich: .*did you mean "max_pitch"\?'),
    ("control.limiter.max_pich = 1\n", r'x\.toml:1: control\.limiter\.max_pich: .*"max_pitch"'),
    ("[vehicle]\nport = 'x'\n", r'x\.toml:2: vehicle\.port: unknown key here; "link\.port" is where it belongs'),
    ("[vehicle]\nzzz = 'x'\n", r"x\.toml:2: vehicle\.zzz: unknown key; known here: battery_cells, name, note"),
    ("[link]\nbaud = 'fast'\n", r'x\.toml:2: link\.baud: a whole number is needed, not "fast"$'),
    ("[link]\nbaud = '57600'\n", r'x\.toml:2: link\.baud: a whole number is needed, not "57600"$'),
    ("[link]\nbaud = 10\n", r"x\.toml:2: link\.baud: must be at least 1200 baud, not 10$"),
    ("[link]\nprobe_baud = 1\n", r"x\.toml:2: link\.probe_baud: true or false is needed, not 1$"),
    ("[link]\nsetpoint_hz = true\n", r"x\.toml:2: link\.setpoint_hz: a number is needed, not true$"),
    ("[link]\nport = 3\n", r"x\.toml:2: link\.port: a text in quotes is needed, not 3$"),
    ("[link]\nport = 2020-01-01\n", r"x\.toml:2: link\.port: a text in quotes is needed$"),
    ("[[cameras]]\nsource = ''\n", r"x\.toml:2: cameras\.0\.source: must not be empty$"),
    ("[link]\nrates = 'fast'\n", r"link\.rates: 'auto' or 'off' or a table \{ \.\.\. \} is needed, not \"fast\"$"),
    ("[link]\nrates = {osd = 5}\n", r"x\.toml:2: link\.rates\.osd: must be at least 10 ms, not 5$"),
    (
        "[control.autopilot]\nmax_tilt = 20\n",
        r"x\.toml:2: control\.autopilot\.max_tilt: must be at most 0\.6 rad, not 20; 20 degrees are 0\.349 rad$",
    ),
    ("[control.autopilot]\nmax_tilt = 90\n", r"max_tilt: must be at most 0\.6 rad, not 90$"),
    ("[control.autopilot]\nmax_tilt = -0.1\n", r"max_tilt: must be above 0 rad, not -0\.1$"),
    ("[control.limiter]\nmax_pitch = 200\n", r"max_pitch: must be at most 127 stick, not 200$"),
    ("[link]\necho_hz = 99\n", r"x\.toml:2: link\.echo_hz: must be at most 50 Hz, not 99$"),
    ("[link]\nreopen_min = 9\n", r"x\.toml:1: link: reopen_min 9 <= reopen_max 1 does not hold$"),
    ("[bus]\nlisten = 'tcp/1:2'\n", r'x\.toml:2: bus\.listen: an array \[ \.\.\. \] is needed, not "tcp/1:2"$'),
    ("[cameras]\nsource = 'x'\n", r"x\.toml:1: cameras: an array of tables \[\[cameras\]\] is needed$"),
    ("[[cameras]]\nsource='x'\n[[cameras]]\nname='b'\n", r"x\.toml:3: cameras\.1\.source: must be given$"),
    (
        "[[cameras]]\nsource='x'\n[[cameras]]\nsource='y'\n[cameras.mount]\nlooks='donw'\n",
        r"x\.toml:6: cameras\.1\.mount\.looks: 'down', .* or 'up' is needed, not \"donw\"$",
    ),
    ("[control.limiter]\nmax_yaw = inf\n", r"x\.toml:2: control\.limiter\.max_yaw: a whole number is needed"),
    ("[control.limiter]\nslew = nan\n", r"x\.toml:2: control\.limiter\.slew: a finite number is needed"),
    ("[control.limiter]\nhover_throttle = 60\nmax_throttle = 50\n", r"x\.toml:1: control\.limiter: .*does not hold"),
    ("[[cameras]]\nsource='x'\nreopen_min = 9\n", r"cameras\.0: reopen_min 9 <= reopen_max 5 does not hold$"),
    ("sim = 3\n", r"x\.toml:1: sim: a table \{ \.\.\. \} is needed, not 3$"),
    ("[control.lease]\nrelease_after = 0.2\n", r"x\.toml:1: control: lease\.release_after must be longer"),
    ("vehicle = 3\n", r"x\.toml:1: vehicle: a section \[vehicle\] is needed, not 3$"),
    ("[vehicle]\nname = 'Mk One'\n", r'x\.toml:2: vehicle\.name: "Mk One" will not do\. Name in every key'),
    ("[link\n", r"x\.toml: not valid TOML: .*line 1"),
    ("[link]\nprot = 1\nbuad = 2\n", r'x\.toml:2: link\.prot: .*"port"\? \(and 1 more\)'),
]


@pytest.mark.parametrize(("text", "message"), MISTAKES)
def test_a_mistake_is_one_line_with_place_and_fix(tmp_path, text, message):
    path = tmp_path / "x.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load(path)
    assert "\n" not in str(caught.value)


def test_a_wrong_override_is_named_as_the_command_lines():
    with pytest.raises(ConfigError, match=r'command line: link\.prot: .*did you mean "port"'):
        load(None, {"link.prot": "x"})
    with pytest.raises(ConfigError, match=r"command line: vehicle: .*not 3"):
        load(None, {"vehicle": 3, "vehicle.name": "x"})


def test_an_override_that_contradicts_a_default_is_named_without_a_file():
    with pytest.raises(
        ConfigError, match=r"^configuration: link: reopen_min 0\.\d+ <= reopen_max 0\.01 does not hold$"
    ):
        load(None, {"link.reopen_max": 0.01})


def test_a_missing_file_names_one_that_is_like_it(tmp_path):
    (tmp_path / "cyberquad.toml").write_text("", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"did you mean .*cyberquad\.toml\?"):
        load(tmp_path / "cyberqad.toml")
    with pytest.raises(ConfigError, match=r"no such configuration file; samples are in .*configs"):
        load(tmp_path / "nothing" / "zzz.toml")


def test_an_unreadable_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        load(tmp_path)
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not UTF-8 text"):
        load(tmp_path / "b.toml")


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.name)
def test_shipped_configurations_load(path):
    assert load(path).vehicle.name


@pytest.mark.parametrize(
    ("port", "words"),
    [
        ("/dev/tty\0USB0", "characters"),
        ("/dev/tty\nUSB0", "characters"),
        ("/dev/" + "A" * 256, "too long"),
        ("/dev" + "/a" * 2000, "too long"),
        ("tcp:" + "a" * 64 + ":2000", "no host"),
        ("tcp:a..b:2000", "no host"),
    ],
)
def test_a_port_that_nothing_can_be_called_is_a_mistake_of_the_configuration(port, words):
    with pytest.raises(ConfigError, match=f"link.port.*{words}"):
        load(None, {"link.port": port})


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
