"""Commands of the system, run for what they say."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from typing import Final, NamedTuple

PATIENCE: Final = 10.0
"""Longest wait for a command [s]."""


NOT_FOUND: Final = 127
"""Exit code where there is no such command, as a shell has it."""


class CommandOutput(NamedTuple):
    """What a command said.

    Attributes:
        code: exit code; 127 where there is no such command, 124 where it did not end.
        out: standard output.
    """

    code: int
    out: str


def run_command(words: Sequence[str]) -> CommandOutput:
    """Run a command of the system and return what it says; what hangs is ended."""
    if shutil.which(words[0]) is None:
        return CommandOutput(NOT_FOUND, "")
    try:
        done = subprocess.run(
            list(words), capture_output=True, text=True, errors="replace", check=False, timeout=PATIENCE
        )
    except (OSError, subprocess.TimeoutExpired):
        return CommandOutput(124, "")
    return CommandOutput(done.returncode, done.stdout)
