"""Tests in forked workers: each runs once and is told, and a worker that dies takes one test with it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.places import ROOT

CONFTEST = """
import os, pytest

@pytest.fixture(scope="session", autouse=True)
def session():
    yield
    write("session ends")

@pytest.fixture(scope="module")
def module(request):
    yield
    write(f"{request.module.__name__} ends")

def write(words):
    with open(os.environ["NOTES"], "a") as notes:
        notes.write(f"{words}\\n")

class Results:
    def pytest_worker_result(self):
        return os.getpid()

    def pytest_worker_ended(self, result):
        write(f"result {result != os.getpid()}")

def pytest_configure(config):
    config.pluginmanager.register(Results())
    config.addinivalue_line("markers", "alone: after the others")

def pytest_collection_finish():
    write("collected")
"""
FIRST = """
import os, pytest
from conftest import write

def test_passes(module, capsys):
    print("heard")
    assert capsys.readouterr().out == "heard\\n"

def test_fails():
    print("what it printed")
    assert 1 == 2

def test_skips():
    pytest.skip("a reason")

def test_kills_its_worker():
    os._exit(3)

def test_after_it(module, tmp_path):
    write("went on")

@pytest.mark.alone
def test_alone():
    write("alone")
"""
SECOND = """
import time

def test_another_file(module):
    time.sleep(0.2)
"""


def run_pytest(folder, *options):
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "NOTES": str(folder / "notes"),
    }
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "tools.workers", *options, str(folder)]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    for name, text in (("conftest", CONFTEST), ("test_first", FIRST), ("test_second", SECOND)):
        (tmp_path / f"{name}.py").write_text(text)
    return tmp_path


def test_everything_runs_once_and_is_told(folder):
    done = run_pytest(folder, "--workers", "2", "-ra")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "2 failed, 4 passed, 1 skipped" in done.stdout
    assert "test_fails - assert 1 == 2" in done.stdout
    assert "what it printed" in done.stdout
    assert "test_kills_its_worker - its worker ended: 3" in done.stdout
    assert "a reason" in done.stdout
    notes = (folder / "notes").read_text().splitlines()
    assert notes.count("collected") == 1
    assert notes.count("went on") == notes.count("alone") == 1
    assert sorted(notes[: notes.index("alone")]) == sorted(
        ["collected", "test_first ends", "test_second ends", "went on", *2 * ["session ends", "result True"]]
    )
    assert notes[notes.index("alone") + 1 :] == ["session ends", "result True"]


def test_the_first_failure_ends_it_where_that_is_asked_for(folder):
    done = run_pytest(folder, "--workers", "1", "-x")
    assert done.returncode == 1
    assert "1 failed, 1 passed" in done.stdout
