"""What tests of the programs share."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mkdaemon.cli.mkctl.app import app
from mkdaemon.cli.program import run

Ctl = Callable[..., tuple[int, str, str]]


@pytest.fixture
def ctl(capsys: pytest.CaptureFixture[str]) -> Ctl:
    def call(at: list[str], *words: str) -> tuple[int, str, str]:
        capsys.readouterr()
        code = run(app, [*words, *at])
        out, err = capsys.readouterr()
        return code, out, err

    return call
