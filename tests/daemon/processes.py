"""`mkdaemon` as a process, the way a user starts it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE = 120.0
"""Longest wait for a process under test [s]; they end in two, but a loaded machine is slow, not wrong."""


@contextmanager
def mkdaemon(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A running `mkdaemon`; killed at the end of the test if it has not ended by itself."""
    command = [sys.executable, "-m", "mkdaemon.cli.mkdaemon.app", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def run_mkdaemon(*arguments: str) -> tuple[int, str, str]:
    """Run `mkdaemon` to its end: exit code, output, errors."""
    with mkdaemon(*arguments) as process:
        out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err
