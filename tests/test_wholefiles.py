"""Files that are collected where they run: the same tests with the same outcomes, each file imported once."""

from __future__ import annotations

import pytest

from tests.places import ROOT

pytest_plugins = ["pytester"]

ONE = """
import pathlib
import pytest

with pathlib.Path("imports.txt").open("a") as imports:
    imports.write("one ")

@pytest.fixture(scope="module")
def shared():
    yield []

@pytest.mark.parametrize("number", range(3))
def test_some_numbers(number, shared):
    shared.append(number)
    assert shared == list(range(number + 1)) and number < 2

@pytest.mark.skip(reason="not here")
def test_skipped():
    pass

def test_left_out():
    pass
"""


@pytest.mark.parametrize("options", [(), ("-n", "2", "--dist", "loadfile", "-p", "tests.wholefiles")])
def test_outcomes_are_those_of_one_process_and_a_file_is_imported_once(pytester, monkeypatch, options):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))  # worker processes begin with the path of a bare interpreter
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function")
    pytester.makepyfile(test_one=ONE, test_broken="import nothing_of_this_name", test_two="def test_two(): pass")
    done = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-k", "not left_out", *options)
    if options:
        done.assert_outcomes(passed=3, failed=1, skipped=1, errors=1)
    assert done.ret != pytest.ExitCode.OK
    assert (pytester.path / "imports.txt").read_text(encoding="utf-8") == "one "
    done.stdout.fnmatch_lines_random(["*nothing_of_this_name*"])


def test_a_file_without_a_selected_test_leaves_nothing_set_up_for_the_next_folder(pytester, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function")
    for folder, name, text in (
        ("a", "test_1", "def test_1(): pass"),
        ("a", "test_2", "import pytest\npytest.skip('not here', allow_module_level=True)"),
        ("b", "test_3", "def test_3(): pass"),
    ):
        package = pytester.path / folder
        package.mkdir(exist_ok=True)
        (package / "__init__.py").touch()
        (package / f"{name}.py").write_text(text)
    options = ("-p", "no:cacheprovider", "-n", "1", "--dist", "loadfile", "-p", "tests.wholefiles")
    pytester.runpytest_inprocess(*options).assert_outcomes(passed=2, skipped=1)
