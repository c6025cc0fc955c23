"""`mkdaemon run`: which name the vehicle has."""

from __future__ import annotations

from pathlib import Path

import pytest

from mkdaemon.cli.mkdaemon.run import vehicle_name


@pytest.mark.parametrize(
    ("config", "given", "name"),
    [(None, None, "other"), (None, "mk2", "mk2"), (Path("mk1.toml"), None, None), (Path("mk1.toml"), "mk2", "mk2")],
)
def test_the_environment_does_not_rename_the_aircraft_of_a_file(config, given, name, monkeypatch):
    monkeypatch.setenv("MK_VEHICLE", "other")
    assert vehicle_name(config, given) == name
