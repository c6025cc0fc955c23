"""Each file is collected by the worker process that runs it: a plugin (`python -m pytest -n 3 -p tests.wholefiles`).

By itself every process of pytest-xdist collects every test: it imports each file and makes each item, and three
processes spent a minute of processor on that. With this plugin a file is one item until it runs.
"""

from __future__ import annotations

import gc
from itertools import pairwise
from pathlib import Path

import pytest


class WholeFile(pytest.Item):
    """A file that was not imported yet; it has the mark `flight` where one of its tests may have it."""

    def __init__(self, name: str, parent: pytest.Collector) -> None:
        super().__init__(name, parent)
        self.add_marker(pytest.mark.timeout(0))  # each of its tests has its own
        if "mark.flight" in self.path.read_text(encoding="utf-8"):
            self.add_marker("flight")

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self.path, None, str(self.path)

    def runtest(self) -> None:
        raise AssertionError("its tests run in place of it")

    def run(self, nextitem: pytest.Item | None) -> None:
        """Collect the tests of the file, and run those that are selected."""
        module = pytest.Module.from_parent(self.parent.parent, path=self.path)  # type: ignore[union-attr]
        items = list(self.session.genitems(module))
        self.config.hook.pytest_collection_modifyitems(session=self.session, config=self.config, items=items)
        gc.freeze()
        gc.enable()
        place = self.session.items.index(self)
        for item, following in pairwise([*items, nextitem]):
            self.session.items[place] = item  # a worker of pytest-xdist reports of no other
            self.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        self.session.items[place] = self
        if not items:  # what the file before left for this one is not needed by the next
            self.session._setupstate.teardown_exact(nextitem)  # as pytest does after a test


class UncollectedModule(pytest.File):
    """Has one item: all that a file holds."""

    def collect(self) -> list[pytest.Item]:
        return [WholeFile.from_parent(self, name="whole")]


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Leave files to those who run them, where there are workers."""
    if not hasattr(parent.config, "workerinput"):
        return None
    return UncollectedModule.from_parent(parent, path=module_path)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a file."""
    if not isinstance(item, WholeFile):
        return None
    item.run(nextitem)
    return True
