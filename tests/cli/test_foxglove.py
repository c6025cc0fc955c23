"""`mkdaemon gateway foxglove`: mistakes are one line that names the fix."""

from __future__ import annotations

import sys

import pytest

from mkdaemon.cli.mkdaemon.app import app
from mkdaemon.cli.mkdaemon.gateway import foxglove as command
from mkdaemon.cli.program import EXIT_CONFIG, run
from mkdaemon.errors import ConfigError


def test_without_the_sdk_one_line_names_the_extra(monkeypatch):
    for name in [name for name in sys.modules if name.startswith(("foxglove", "mkdaemon.gateways.foxglove."))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ConfigError, match=r"needs foxglove-sdk: pip install 'mkdaemon\[foxglove\]'"):
        command.foxglove()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--port", "70000"], "--port 70000: give one from 1 to 65535"),
        (["--vehicle", "Über"], "--vehicle 'Über': a name has lower-case letters"),
    ],
)
def test_a_number_or_a_name_that_cannot_be_is_named(options, words, capsys):
    assert run(app, ["gateway", "foxglove", *options]) == EXIT_CONFIG
    assert words in capsys.readouterr().err
