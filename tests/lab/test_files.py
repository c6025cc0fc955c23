"""A seeded subset of `python -m lab files`, in this process; the whole of it is run there."""

from __future__ import annotations

import time

import pytest
import structlog

from lab.files.commands import READERS
from lab.files.main import faults_of, good_files
from lab.files.mutations import REPEATED, SPECIAL, spoil
from lab.files.originals import Kind
from lab.files.running import APPS, MOST_CPU, Ended
from mkdaemon.cli.program import run

OUTSIDE = ("--connect", "play", "run", "doctor", "shutter", "camera")
"""Commands that meet the bus or the machine: only the campaign has a process for each."""
INSIDE = [one for one in READERS if not set(one.words) & {*OUTSIDE}]


@pytest.fixture(scope="module")
def goods(tmp_path_factory):
    folder = tmp_path_factory.mktemp("goods")
    good_files(folder)
    return folder


@pytest.fixture
def try_file(goods, tmp_path, capfd):
    """Gives a file to a command; returns what is wrong with how that ended."""
    logging = structlog.get_config()

    def call(reader, path):
        folder = tmp_path / f"out{reader.name.__hash__()}"
        folder.mkdir(exist_ok=True)
        places = {
            "file": path,
            "folder": folder,
            "good": goods / f"good{reader.kind}",
            "picture": goods / f"good{Kind.PICTURE}",
        }
        capfd.readouterr()
        began = time.process_time()
        code = run(APPS[reader.program], [word.format(**places) for word in reader.words])
        ended = Ended(code, time.process_time() - began, 0.0, 0, *capfd.readouterr())
        return faults_of(ended)

    yield call
    structlog.configure(**logging)


@pytest.mark.parametrize("seed", range(1))
@pytest.mark.parametrize("reader", INSIDE, ids=lambda one: one.name)
def test_a_spoilt_file_ends_with_a_word_and_soon(try_file, tmp_path, reader, seed):
    path = tmp_path / f"hostile{reader.kind}"
    path.write_bytes(spoil(reader.kind, seed))
    assert try_file(reader, path) == []


@pytest.mark.parametrize("number", range(len(INSIDE)))
def test_what_is_no_file_or_very_long_ends_with_a_word_and_soon(try_file, tmp_path, number):
    reader = INSIDE[number]
    path = tmp_path / f"hostile{reader.kind}"
    name = list(SPECIAL)[number % len(SPECIAL)]
    SPECIAL[name](path)
    assert try_file(reader, path) == [], name
    path = tmp_path / f"long{reader.kind}"
    part = REPEATED[number % len(REPEATED)]
    path.write_bytes(part * (200_000 // len(part)))
    assert try_file(reader, path) == [], part


def test_what_is_wrong_is_seen():
    assert faults_of(Ended(0, 0.1, 0.1, 1, "a", "")) == []
    assert faults_of(Ended(1, 0.1, 0.1, 1, "", "")) == ["failed without a word"]
    assert faults_of(Ended(-9, MOST_CPU + 1, 0.1, 10**9, "\x1b", "x")) == [
        "ended with -9", "took 6.0 s", "took 1000 MB", "printed '\\x1b'"
    ]  # fmt: skip
    assert faults_of(Ended(70, 0.1, 0.1, 1, "", 'Traceback\n File "/a/src/b.py", line 3\nValueError: c')) == [
        "traceback: ValueError: c at b.py:3"
    ]
