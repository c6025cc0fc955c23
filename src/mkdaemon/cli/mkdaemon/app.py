"""`mkdaemon`: the daemon and everything that runs beside it on the machine with the serial line."""

from __future__ import annotations

import os
from typing import NoReturn

from mkdaemon.cli.mkdaemon.commands import ABOUT, COMMANDS
from mkdaemon.cli.program import build as _build
from mkdaemon.cli.program import main as _main

app = _build("mkdaemon", ABOUT, COMMANDS)


def main() -> NoReturn:
    """Entry point."""
    # numpy's OpenBLAS starts a thread for every core, which wait for each other longer than they compute: matrices of
    # a pose are small. Read when numpy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _main("mkdaemon", ABOUT, COMMANDS)


if __name__ == "__main__":
    main()
