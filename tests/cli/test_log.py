"""`mkctl log` on recordings that are whole, damaged or not there."""

from __future__ import annotations

import json
from functools import partial

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import EXIT_CONFIG, EXIT_FAILURE, EXIT_OK
from mkdaemon.record.reader import Recording
from tests.record.support import sample
from tests.record.test_tools import ENTRIES, written


@pytest.fixture
def log(typed):
    return partial(typed, app, "log")


@pytest.fixture
def whole(tmp_path):
    return written(tmp_path / "whole.mcap", [*ENTRIES, sample(1, "mk/mk1/event/mark")])


@pytest.fixture
def damaged(tmp_path, whole):
    path = tmp_path / "damaged.mcap"
    content = bytearray(whole.read_bytes())
    content[content.index(b"zstd", len(content) // 3) + 40] ^= 1  # inside a chunk
    path.write_bytes(content[:-100])
    return path


def test_info_shows_keys_and_marks(log, whole):
    code, out, _ = log("info", whole)
    assert code == EXIT_OK
    assert "blackbox mk1-20261122T080000Z, part 0" in out
    assert "mk/mk1/state/0" in out
    assert "mark" in out
    code, out, _ = log("info", whole, "--json")
    fields = json.loads(out)
    assert fields["entries"] == 201
    assert fields["whole"] is True
    assert {key["key"] for key in fields["keys"]} == {"mk/mk1/state/0", "mk/mk1/state/1", "mk/mk1/event/mark"}
    assert len(fields["marks"]) == 1


def test_verify_shows_whether_a_recording_is_whole(log, whole, damaged):
    assert log("verify", whole)[0] == EXIT_OK
    code, out, _ = log("verify", whole, damaged)
    assert code == EXIT_FAILURE
    assert "whole.mcap: whole, 201 entries" in out
    assert "damaged.mcap: not whole" in out
    assert "mkctl log repair" in out
    assert "missing by their numbers" in out
    code, out, _ = log("verify", damaged, "--json")
    assert json.loads(out)["damages"]


def test_repair_writes_beside_the_old_one_and_never_over_another(log, damaged):
    code, out, _ = log("repair", damaged)
    assert code == EXIT_OK
    target = damaged.with_name("damaged-recovered.mcap")
    assert f"{target}: " in out
    assert "are missing by their numbers" in out
    assert len(list(Recording(target).entries())) >= 160
    code, _, err = log("repair", damaged)
    assert (code, "--force" in err) == (EXIT_CONFIG, True)
    code, out, _ = log("repair", damaged, "--force", "--viewer", "--json")
    assert json.loads(out)["file"] == str(target)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--from", "1", "--to", "-0.5"], 50),
        (["--key", "state/0"], 100),
        (["--key", "mk/mk1/state/1", "-k", "state/0", "--from", "-1"], 102),
        (["--from", "2025-10-09T08:53:21.6Z"], 201),
    ],
)
def test_cut_takes_what_was_asked_for(log, whole, tmp_path, words, expected):
    code, out, err = log("cut", whole, "-o", tmp_path / "part.mcap", *words)
    assert (code, err) == (EXIT_OK, "")
    assert f"{expected} entries" in out
    assert list(Recording(tmp_path / "part.mcap").entries())


def test_merge_joins(log, whole, tmp_path):
    other = written(tmp_path / "other.mcap", [entry._replace(key="mk/mk2/state/x") for entry in ENTRIES[:5]])
    assert log("merge", whole, other, "-o", tmp_path / "all.mcap")[0] == EXIT_CONFIG, "both say they are the same part"
    code, out, _ = log("merge", other, "-o", tmp_path / "all.mcap")
    assert (code, "5 entries" in out) == (EXIT_OK, True)


def test_list_shows_what_there_is(log, whole, damaged, tmp_path, monkeypatch):
    code, out, _ = log("list", tmp_path)
    assert code == EXIT_OK
    assert "whole.mcap" in out
    assert "not finished" in out
    code, out, _ = log("list", tmp_path, "--json")
    assert [json.loads(line)["finished"] for line in out.splitlines()] == [False, True]
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))
    assert "no recordings in" in log("list")[1]
    folder = tmp_path / "home" / "mkdaemon" / "mk1" / "recordings"
    folder.mkdir(parents=True)
    written(folder / "mine.mcap")
    assert "mine.mcap" in log("list")[1]
