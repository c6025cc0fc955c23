"""The section [sim]: read with the rest of a file, its mistakes named as those of the daemon's sections are."""

from __future__ import annotations

import pytest

from mkdaemon.errors import ConfigError
from mksim.config import load_simulator


def test_overrides_lie_over_the_file(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text('[link]\nport = "/dev/ttyUSB0"\n[sim]\nboard = "fc"\n', encoding="utf-8")
    cfg = load_simulator(path, {"vehicle.name": "m2", "sim.listen": "localhost:7000"})
    assert (cfg.link.port, cfg.vehicle.name) == ("/dev/ttyUSB0", "m2")
    assert (cfg.sim.board, cfg.sim.listen) == ("fc", "localhost:7000")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[sim]\npilot_plan = 'loop'\n", r"x\.toml:2: sim\.pilot_plan: 'circle', .* is needed, not \"loop\"$"),
        ("[sim]\nlisten = 'h:70000'\n", r"x\.toml:2: sim\.listen: 'h:70000': a TCP port is 0 to 65535$"),
        ("[sim.radio.to_host]\nlatency_mean = 0.06\n", r"latency_mean 0\.06 must lie between latency_min"),
        ("[sim]\ntruncate_sticks = true\n", r'x\.toml:2: .*"sim\.flight\.loop\.truncate_sticks" is where it belongs$'),
        ('[link]\nprot = "x"\n', r'x\.toml:2: link\.prot: unknown key; did you mean "port"\?'),
        ("sim = 3\n", r"x\.toml:1: sim: a section \[sim\] is needed, not 3$"),
    ],
)
def test_a_mistake_is_one_line_with_place_and_fix(tmp_path, text, message):
    path = tmp_path / "x.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load_simulator(path)
    assert "\n" not in str(caught.value)
