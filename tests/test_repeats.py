"""Tests in real time: a failure stands unless the machine stood still, repeats are printed, and too many fail a run."""

from __future__ import annotations

import pytest

from tests.places import ROOT

pytest_plugins = ["pytester"]

CONFTEST = f"""
import sys

import pytest

sys.path.insert(0, {str(ROOT)!r})  # worker processes begin with the path of a bare interpreter
from tests import repeats

def pytest_configure(config):
    config.addinivalue_line("markers", "real_time(tolerance): x")
    config.pluginmanager.register(repeats.Repeats(), "repeats-under-test")
"""
FAILS_ONCE = """
import time
import pytest

tries = []

@pytest.mark.real_time(tolerance={tolerance})
@pytest.mark.parametrize("number", range({count}))
def test_that_fails_the_first_time(number):
    tries.append(number)
    time.sleep(0.05)
    assert tries.count(number) > {failures}
"""

INCONCLUSIVE = """
import pytest
from tests.repeats import InconclusiveError

tries = []

@pytest.mark.real_time(tolerance={tolerance})
@pytest.mark.parametrize("number", range({count}))
def test_that_measures_the_machine(number):
    tries.append(number)
    if tries.count(number) <= {failures}:
        raise InconclusiveError("late by 2 s")
"""


@pytest.fixture
def make_run(pytester):
    """Run such a file; the machine stood still if the tolerance is below nothing."""

    def make(*options, tolerance, count=1, failures=1, what=FAILS_ONCE):
        pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function")
        pytester.makeconftest(CONFTEST)
        pytester.makepyfile(what.format(tolerance=tolerance, count=count, failures=failures))
        return pytester.runpytest_inprocess("-p", "no:cacheprovider", *options)

    return make


HELD_UP, STEADY = -1.0, 60.0
PASSED, FAILED = pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED


def test_a_test_that_was_held_up_is_repeated_once_and_counted(make_run):
    done = make_run(tolerance=HELD_UP)
    done.assert_outcomes(passed=1)
    assert done.ret == PASSED
    done.stdout.fnmatch_lines(
        ["*test_that_fails_the_first_time*the machine stood still for*", "1 of 1 repeated; 3 may be"]
    )


def test_on_a_steady_machine_a_failure_stands(make_run):
    done = make_run(tolerance=STEADY)
    done.assert_outcomes(failed=1)
    done.stdout.fnmatch_lines(["0 of 1 repeated; 3 may be"])


@pytest.mark.parametrize(("failures", "outcome"), [(1, {"passed": 1}), (2, {"failed": 1})])
def test_an_inconclusive_test_is_repeated_once_on_a_steady_machine_too(make_run, failures, outcome):
    done = make_run(tolerance=STEADY, failures=failures, what=INCONCLUSIVE)
    done.assert_outcomes(**outcome)
    done.stdout.fnmatch_lines(["*inconclusive: late by 2 s", "1 of 1 repeated; 3 may be"])


def test_a_second_failure_stands(make_run):
    make_run(tolerance=HELD_UP, failures=2).assert_outcomes(failed=1)


@pytest.mark.parametrize(
    ("options", "count", "code"),
    [((), 3, PASSED), ((), 4, FAILED), (("-n", "2"), 4, FAILED)],
    ids=["three", "four", "four in two processes"],
)
def test_more_than_three_repeats_fail_a_run_whose_tests_all_passed(make_run, options, count, code):
    done = make_run(*options, tolerance=HELD_UP, count=count)
    done.assert_outcomes(passed=count)
    assert done.ret == code
    done.stdout.fnmatch_lines([f"{count} of {count} repeated; 3 may be"])
