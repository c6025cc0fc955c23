"""`mkdaemon` as a process, started the way a user starts it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

PATIENCE: Final = 120.0
"""Longest wait for a program that ends in two seconds on an idle machine [s]; a loaded machine is slow, not wrong."""
COMMAND: Final = (sys.executable, "-m", "mkdaemon.cli.mkdaemon.app")


@contextmanager
def mkdaemon(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A running `mkdaemon`; ended with the context if it has not ended by itself."""
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()  # it ends what it started itself
        try:
            process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def run_mkdaemon(*arguments: str) -> tuple[int, str, str]:
    """Run `mkdaemon` to its end.

    Returns:
        Exit code, output, errors.

    Raises:
        subprocess.TimeoutExpired: it did not end in time.
    """
    with mkdaemon(*arguments) as process:
        out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err
