"""A newcomer's terminals: a new home, nothing of the developer's environment, and programs that keep running."""

from __future__ import annotations

import ctypes
import os
import re
import shlex
import signal
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from tools.walkplan import Kind, Manner

KEPT: Final = re.compile(r"PATH|LANG|LC_\w+|TMPDIR|PIP_\w+|SSL_CERT_\w+|REQUESTS_CA_BUNDLE|\w+_(proxy|PROXY)|no_proxy")
"""What a new terminal of this machine has too: where programs lie, the language, how the network is reached."""
USER: Final = "alice"
COLUMNS: Final = "100"
"""Width of the terminals."""
LOOK: Final = 0.2
"""Between two looks at what a program has printed [s]."""
SETTLING: Final = 5.0
"""Time before Ctrl-C for a program without a line that it must show [s]."""
ENDING: Final = 90.0
"""Longest end of a program after Ctrl-C [s]."""
AGAIN: Final = 2.0
"""Between two attempts of what is typed again [s]."""
_CLONE_NEWNET: Final = 0x40000000
"""Of unshare(2)."""
_ADOPTED: Final = ("export ", ". ", "cd ")
"""Lines that change the terminal itself."""
_ENDED: Final = (0, 128 + signal.SIGINT, -signal.SIGINT)


class Typed(NamedTuple):
    """What a line came to.

    Attributes:
        text: standard output and standard error, as they came.
        code: exit code; None for what still runs.
        wrong: what is wrong with it, as a sentence; empty for nothing.
    """

    text: str
    code: int | None
    wrong: str = ""


def clean_environment(home: Path, root: Path) -> dict[str, str]:
    """The environment of a user who has just logged in.

    Args:
        home: his home.
        root: of the developer's tree, of which nothing is on his path.
    """
    kept = {name: value for name, value in os.environ.items() if KEPT.fullmatch(name)}
    hidden = (str(root), os.environ.get("VIRTUAL_ENV") or str(root))
    folders = [folder for folder in kept["PATH"].split(os.pathsep) if not folder.startswith(hidden)]
    return kept | {
        "PATH": os.pathsep.join(folders),
        "HOME": str(home),
        "USER": USER,
        "LOGNAME": USER,
        "COLUMNS": COLUMNS,
        "TERM": "dumb",
    }


def leave_network() -> bool:
    """Go, with everything that is started from now on, where only loopback is; False where that is not permitted."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_CLONE_NEWNET) != 0:
        return False
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    return True


class Program:
    """What a line has started, with its terminal: where, in which environment, and a file for what it prints."""

    def __init__(self, script: str, folder: Path, environment: Mapping[str, str], output: Path) -> None:
        self._output = output
        with output.open("wb") as printed:
            self._process = subprocess.Popen(
                ["bash", "-c", script],
                cwd=folder,
                env={**environment, "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.PIPE,
                stdout=printed,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def wait_until_shown(self, manner: Manner) -> Typed:
        """Wait until it has printed what its manner says, or for some time where that says nothing."""
        ends = time.monotonic() + (manner.patience if manner.shows else SETTLING)
        while not (manner.shows and re.search(manner.shows, self._read())):
            if (code := self._process.poll()) is not None:
                return Typed(self._read(), code, f"ended by itself with exit code {code}")
            if time.monotonic() > ends:
                return Typed(self._read(), None, f"did not show {manner.shows}" if manner.shows else "")
            time.sleep(LOOK)
        return Typed(self._read(), None)

    def finish(self, within: float, key: str = "") -> Typed:
        """Wait until it ends, by itself or because a key is pressed; it is killed where it does not in time.

        Args:
            within: longest time [s].
            key: `Ctrl-C` or `Enter`; empty for none.
        """
        wrong, code = "", self._process.poll()
        if key and code is not None:
            wrong = f"had ended by itself, with exit code {code}"
        elif key == "Ctrl-C":
            self._process.send_signal(signal.SIGINT)
        try:
            self._process.communicate(b"\n" if key == "Enter" else None, timeout=within)
            if key and not wrong and self._process.returncode not in _ENDED:
                wrong = f"ended with exit code {self._process.returncode} after {key}"
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)  # and everything in its terminal
            self._process.wait()
            wrong = f"did not end within {within:g} s"
        return Typed(self._read(), self._process.returncode, wrong)

    def _read(self) -> str:
        return self._output.read_text(encoding="utf-8", errors="replace")


class Terminals:
    """The terminals in which one page is followed."""

    def __init__(self, folder: Path, environment: Mapping[str, str], outputs: Path) -> None:
        """Open them.

        Args:
            folder: where everything is typed.
            environment: of the first line.
            outputs: an empty folder for what is printed.
        """
        self._folder, self._environment, self._outputs = folder, dict(environment), outputs
        self._running: dict[str, Program] = {}
        self._count = 0

    def type(self, line: str, manner: Manner) -> Typed:
        """Type a line, and wait as long as its manner says."""
        if manner.kind is Kind.REPEATED:
            return self._repeat(line, manner)
        if manner.kind is Kind.TO_END:
            return self._complete(line, manner)
        program = self._started(f"exec {line}")
        seen = program.wait_until_shown(manner)
        if seen.wrong:
            program.finish(0.0)
        elif manner.kind is Kind.STAYS:
            self._running[line] = program
        else:
            return program.finish(ENDING, "Enter" if manner.kind is Kind.ENTERED else "Ctrl-C")
        return seen

    def interrupt(self, words: str) -> Typed:
        """Press Ctrl-C where a program runs on, and wait for its end.

        Args:
            words: part of its line.
        """
        line = next((line for line in self._running if words in line), None)
        if line is None:
            return Typed("", None, f"{words} does not run")
        return self._running.pop(line).finish(ENDING, "Ctrl-C")

    def close(self) -> dict[str, Typed]:
        """Press Ctrl-C wherever something runs on, the last first; what it came to, by line."""
        return {line: self.interrupt(line) for line in reversed(list(self._running))}

    def _started(self, script: str) -> Program:
        self._count += 1
        return Program(script, self._folder, self._environment, self._outputs / str(self._count))

    def _complete(self, line: str, manner: Manner) -> Typed:
        if not line.startswith(_ADOPTED):
            return self._started(line).finish(manner.patience)
        marker = self._outputs / "environment"
        done = self._started(f"{line} && env -0 >{shlex.quote(str(marker))}").finish(manner.patience)
        if done.code == 0:
            pairs = (pair.partition("=") for pair in marker.read_text(encoding="utf-8").split("\0") if pair)
            self._environment = {name: value for name, _, value in pairs}
            self._folder = Path(self._environment["PWD"])
        return done

    def _repeat(self, line: str, manner: Manner) -> Typed:
        ends = time.monotonic() + manner.patience
        while True:
            done = self._complete(line, manner)
            if done.wrong or re.search(manner.shows, done.text):
                return done
            if time.monotonic() > ends:
                return done._replace(wrong=f"never showed {manner.shows}")
            time.sleep(AGAIN)
