"""Every name that the product imports from a library is there: most of them are loaded when they are used.

A class of the gateways was renamed, and with it the name of one of rclpy's in an import inside a function. No test of
`make test` came by there, and a node with parameters could not be made.
"""

from __future__ import annotations

import ast
import importlib

import pytest

from tests.places import SOURCE

SOURCES = SOURCE.parent
OURS = {each.name for each in SOURCES.iterdir()} | {"__future__"}


def imported():
    """Each name that a file imports from a library: file, line, module, name."""
    for path in sorted(SOURCES.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] not in OURS:
                for each in node.names:
                    yield path.relative_to(SOURCES), node.lineno, node.module, each.name


def is_there(module, name):
    """Whether a module has a name; None where the module is not installed."""
    try:
        found = importlib.import_module(module)
    except ImportError:
        return None
    if hasattr(found, name):
        return True
    try:
        importlib.import_module(f"{module}.{name}")
    except ImportError:
        return False
    return True


def lacking(answer):
    found = [(f"{path}:{line}", module, name) for path, line, module, name in imported()]
    return [each for each in found if is_there(*each[1:]) is answer]


@pytest.mark.gateways
def test_every_library_is_installed_and_has_what_is_imported():
    assert lacking(None) == lacking(False) == []
