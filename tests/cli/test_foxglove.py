"""`mkdaemon gateway foxglove`: mistakes are one line that names the fix."""

from __future__ import annotations

import sys

import pytest

from mkdaemon.cli.mkdaemon.gateway import foxglove as command
from mkdaemon.errors import ConfigError


def test_without_the_sdk_one_line_names_the_extra(monkeypatch):
    for name in [name for name in sys.modules if name.startswith(("foxglove", "mkdaemon.gateways.foxglove."))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ConfigError, match=r"needs foxglove-sdk: pip install 'mkdaemon\[foxglove\]'"):
        command.foxglove()
