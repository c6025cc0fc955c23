"""What tests of the programs share."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
from cyclopts import App

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import run
from mkdaemon.telemetry.mission import Mission, MissionPoint

Ctl = Callable[..., tuple[int, str, str]]


@pytest.fixture
def typed(capsys: pytest.CaptureFixture[str]) -> Ctl:
    """Runs a command of a program: its exit code, what it printed, and its complaints."""

    def call(program: App, *words: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = run(program, [str(word) for word in words])
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.fixture
def ctl(typed: Ctl) -> Ctl:
    return partial(typed, app)


def mission(count: int) -> Mission:
    """Points near the simulated aircraft."""
    points = (
        MissionPoint(latitude_deg=53.23 + n / 1e5, longitude_deg=7.459, altitude=10 + n, hold=n) for n in range(count)
    )
    return Mission(points=tuple(points))
