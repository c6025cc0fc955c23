"""Fixtures every test may use."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read when numpy is imported

import cv2
import pytest
import structlog
from hypothesis import HealthCheck, settings

from tests.orphans import no_orphans
from tests.places import DATA, REFERENCE
from tests.repeats import Repeats

# A loaded machine is slow, not wrong: how long an example takes, or takes to draw, says nothing about the code.
# Every run draws the same examples; `pytest --hypothesis-profile=explore` draws new ones, and forty times as many.
SLOW = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("house", max_examples=25, derandomize=True, **SLOW)
settings.register_profile("explore", max_examples=1000, **SLOW)
settings.load_profile("house")

# As in the daemon (`vision.worker`): with a thread for every core, and tests in every core, the threads of OpenCV wait
# for each other, and tests of images take half as long again. Those of OpenBLAS do, too.
cv2.setNumThreads(1)

# Who starts the tests in the background or under nohup leaves signals ignored, and every program would inherit that.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGTERM, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)


LONG = {"stories", "tools", "vision"}
"""Folders with files that take long."""


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Repeats(), "repeats")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that start whole programs come first: beside those that compute, what runs in real time comes too late.

    Then come the folders whose files take long: at the end one process would work on such a file while others wait.
    """
    slow = {item.path for item in items if item.get_closest_marker("flight")}
    items.sort(key=lambda item: (item.path not in slow, not LONG & set(item.path.parts)))


def pytest_collectstart() -> None:
    gc.disable()


def pytest_collection_finish() -> None:
    """What was collected stays to the end: the garbage collector need not look through it again and again."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def surroundings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The same on every machine: a home of our own, no settings of the user's, no colours; and nothing stays behind."""
    home = str(tmp_path_factory.mktemp("home"))
    with no_orphans() as mark, pytest.MonkeyPatch.context() as patch:
        for name in os.environ:
            if name.startswith(("MK_", "XDG_", "ZENOH_")) or name in {
                "FORCE_COLOR",
                "NOTIFY_SOCKET",
                "WATCHDOG_USEC",
                "RUNTIME_DIRECTORY",
                "STATE_DIRECTORY",
            }:
                patch.delenv(name)
        for name, value in {
            "HOME": home,
            "XDG_RUNTIME_DIR": home,
            "NO_COLOR": "1",
            "TERM": "dumb",
            "COLUMNS": "120",
            **mark,
        }.items():
            patch.setenv(name, value)
        yield


@pytest.fixture(scope="module", autouse=True)
def logs() -> Iterator[None]:
    """Programs that run in this process set up logging as a process does: for good."""
    before = structlog.get_config()
    yield
    structlog.configure(**before)


@pytest.fixture(scope="module", autouse=True)
def endpoints() -> Iterator[None]:
    """Endpoints are reserved until the end of a file's tests; who reserved none need not import the bus for that."""
    yield
    if (support := sys.modules.get("tests.bus.support")) is not None:
        support.give_back_endpoints()


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference material beside the checkout; tests that want it skip where it is absent."""
    if not (REFERENCE / "README.md").is_file():
        pytest.skip("reference material (../shared) is not beside this checkout")
    return REFERENCE


@pytest.fixture(scope="session")
def fixtures() -> Path:
    """Recorded bytes and expected values kept with the tests."""
    return DATA
