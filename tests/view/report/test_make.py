"""Reports of recordings that are damaged, empty, of several vehicles, or made by an enemy."""

from __future__ import annotations

import msgpack
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.reading.known import EVENTS
from mkdaemon.record.entry import EntryKind
from mkdaemon.record.rewrite import merge
from mkdaemon.view.report.make import report_of
from mkdaemon.view.report.page import render
from tests.places import DATA
from tests.view.report.compared import add_poses, tracks
from tests.view.report.known import Tape, known_flight, write_known

RECORDINGS = sorted((DATA / "recordings").glob("*.mcap"))


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    return write_known(tmp_path_factory.mktemp("known") / "known.mcap")


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.stem)
def test_every_recorded_flight_has_its_report(path):
    report = report_of(path, None)
    assert report.losses == []
    assert "Automatic flight for " in report.sentences[1]
    assert {plot.name for plot in report.plots} >= {"events", "attitude", "sticks", "link", "battery"}
    name, parameters = report.parameters
    assert (name, len(parameters) > 100) == ("Easy", True) if "nc" not in path.stem else (name, not parameters)
    assert b'id="plot-events"' in render(report, "")


def test_a_recording_that_was_cut_off_tells_so_and_progress_is_shown(known, tmp_path):
    told = []
    report_of(known, None, told.append)
    assert told
    assert max(told) <= known.stat().st_size
    path = tmp_path / "cut.mcap"
    path.write_bytes(known.read_bytes()[:-200])
    report = report_of(path, None)
    assert "is not finished" in report.losses[0]
    assert "The recording is not whole" in render(report, "").decode()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged") / "damaged.mcap"


@settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(data=st.data())
def test_a_damaged_recording_has_a_report_that_tells_it_or_one_clear_error(known, shared, data):
    content = bytearray(known.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    shared.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        report = report_of(shared, None)
    except MkError as error:
        assert str(shared) in str(error)
    else:
        render(report, "")


STRANGE = st.recursive(
    st.one_of(
        *(st.none(), st.booleans(), st.integers(-(2**63), 2**63), st.floats()),
        *(st.text(max_size=5), st.binary(max_size=5)),
    ),
    lambda inner: (
        st.lists(st.floats(), min_size=3, max_size=4)
        | st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=6,
)
KEYS = [
    *("control/status", "control/estimate", "control/error", "link/health", "link/state", "health", "state/battery"),
    *("vision/down/pose", "vision/down/setup", "vision/down/tags", "vision/down/refused", "positions/mocap/report"),
    *("vision/down/stats", "vision//pose", "vision/down/image", "rx/fc/settings", "link/traffic", *EVENTS),
]
FIELDS = [
    *("phase", "manoeuvre", "stage", "position", "goal", "error_pad", "echo", "state", "condition", "firmware", "fix"),
    *("refused", "alarms", "dropped", "fields", "key", "status", "stamp", "voltage", "step", "level", "posed"),
    *("pixels", "position_target", "quaternion_target_from_flu", "sequence", "target", "latency", "age"),
    *("lens", "targets"),
]


TRACKS = tracks(seconds=2.7)
"""With as many poses as a comparison needs."""


@settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(
    values=st.lists(
        st.tuples(st.sampled_from(KEYS), st.dictionaries(st.sampled_from(FIELDS), STRANGE, max_size=6)), min_size=1
    )
)
def test_no_value_makes_a_report_or_a_comparison_fail(values, shared):
    tape = Tape((0.0, "control/status", {"phase": "flying", "manoeuvre": "hold"}))
    for name, track in zip(("down", "mocap"), TRACKS, strict=True):
        add_poses(tape, name, track)
    for number, (suffix, fields) in enumerate(values):
        kind = EntryKind.IMAGE if suffix.endswith("image") else EntryKind.SAMPLE
        tape.add(number / 7, suffix, fields, kind)
        tape.add(number / 7, suffix, msgpack.packb(fields))
    path = tape.write(shared, config='{"a": "\\ud800"}')
    render(report_of(path, None, against="mocap"), "")


def test_a_recording_of_several_vehicles_asks_which(known, tmp_path):
    other = known_flight(vehicle="mk2").write(tmp_path / "other.mcap")
    both = tmp_path / "both.mcap"
    merge([known, other], both)
    with pytest.raises(ConfigError, match=r"choose one with --vehicle: mk1, mk2"):
        report_of(both, None)
    assert report_of(both, "mk2").vehicle == "mk2"
    with pytest.raises(ConfigError, match=r"no values of vehicle mk3, only of mk1, mk2"):
        report_of(both, "mk3")


def test_a_recording_with_nothing_in_it_is_one_clear_error(tmp_path):
    with pytest.raises(MkError, match="nothing to report"):
        report_of(Tape().write(tmp_path / "empty.mcap"), None)
    (tmp_path / "text.mcap").write_text("no recording")
    with pytest.raises(MkError, match="nothing to report"):
        report_of(tmp_path / "text.mcap", None)
    with pytest.raises(MkError, match="cannot be opened"):
        report_of(tmp_path / "nowhere.mcap", None)
