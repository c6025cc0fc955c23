"""The samples of configs/systemd/, made from the table of `mkdaemon install-service`."""

from __future__ import annotations

from pathlib import Path

from mkdaemon.cli.mkdaemon.service.units import UNITS, unit_text


def daemon(_root: Path) -> str:
    """Return the unit of the only daemon of a machine."""
    return _sample("mkdaemon.service")


def daemon_of_many(_root: Path) -> str:
    """Return the template of one daemon of many."""
    return _sample("mkdaemon@.service")


def recorder(_root: Path) -> str:
    """Return the unit of the ground recorder."""
    return _sample("mkdaemon-recorder.service")


def gateway(_root: Path) -> str:
    """Return the template of the gateways."""
    return _sample("mkdaemon-gateway@.service")


def _sample(name: str) -> str:
    return next(unit_text(unit) for unit in UNITS if unit.name == name)
