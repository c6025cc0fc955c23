"""Measurements as CSV."""

from __future__ import annotations

import pytest

from mkdaemon.client.linktest.measures import LoadRun
from mkdaemon.client.linktest.probefile import HEADER, read_csv, to_csv
from mkdaemon.client.linktest.probes import Probe, ProbeKind
from mkdaemon.errors import ConfigError

RUNS = [
    LoadRun('XBee, "attic"', "light", 0.0, (Probe(ProbeKind.ECHO, 0.0, 0.0423), Probe(ProbeKind.ECHO, 0.2, None))),
    LoadRun('XBee, "attic"', "full", 15.0, (Probe(ProbeKind.CONTROL, 0.5, 0.0101), Probe(ProbeKind.ECHO, 0.6, 0.05))),
]


def test_what_was_written_is_read_again(tmp_path):
    file = tmp_path / "radio.csv"
    file.write_text(to_csv(RUNS))
    assert read_csv(file) == RUNS


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "its first line is"),
        (b"a,b\n", "its first line is"),
        (b"\xff\xfe", "no CSV of"),
        (",".join(HEADER).encode() + b"\n", "no measurement"),
        (",".join(HEADER).encode() + b"\nx,light,0,link test,0.1\n", "line 2: not enough values"),
        (",".join(HEADER).encode() + b"\nx,light,0,telepathy,0.1,5\n", "line 2: 'telepathy'"),
        (",".join(HEADER).encode() + b"\nx,light,0,link test,nan,5\n", "line 2: nan is not a figure"),
        (",".join(HEADER).encode() + b"\nx,light,0,link test,0,-5\n", "line 2: -5 is not a figure"),
    ],
)
def test_another_file_is_refused_by_line(tmp_path, content, complaint):
    file = tmp_path / "other.csv"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=complaint):
        read_csv(file)
    with pytest.raises(ConfigError, match="No such file"):
        read_csv(tmp_path / "none.csv")
