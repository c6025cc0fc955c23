"""Commands of `mkdaemon` one after another in a process of its own, in which something is missing.

Not those that keep a log: a thread of theirs prints, when it comes to it, and whatever is standard error by then.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable, Sequence
from typing import NamedTuple

PROGRAM = """
import json, sys
from contextlib import redirect_stderr, redirect_stdout
from tempfile import TemporaryFile

missing, imported, *commands = json.loads(sys.argv[1])
sys.modules |= dict.fromkeys(missing)  # None: as if they were not installed
for module in imported:
    __import__(module)
from mkdaemon.cli.mkdaemon.app import main

for words in commands:
    sys.argv = ["mkdaemon", *words]
    with TemporaryFile("w+") as out, TemporaryFile("w+") as err:
        with redirect_stdout(out), redirect_stderr(err):
            try:
                main()
            except SystemExit as ended:
                code = ended.code
        out.seek(0)
        err.seek(0)
        answer = [code, out.read(), err.read()]
    print(json.dumps(answer), flush=True)
"""


class Ended(NamedTuple):
    """What a command came to."""

    code: int
    out: str
    err: str


def run_commands(commands: Iterable[Sequence[str]], *, missing: Sequence[str], imported: Sequence[str]) -> list[Ended]:
    """What commands come to where some modules are missing and some others can be imported nevertheless."""
    task = json.dumps([missing, imported, *commands])
    done = subprocess.run([sys.executable, "-c", PROGRAM, task], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    return [Ended(*json.loads(line)) for line in done.stdout.splitlines()]
