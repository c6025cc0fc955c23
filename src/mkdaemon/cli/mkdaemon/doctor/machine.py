"""The machine that the doctor looks at: files below a root, commands, and a few questions to the system.

A test gives it another root, with a fake /dev, /proc and /sys below it, and other answers.
"""

from __future__ import annotations

import grp
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.cli.mkdaemon.doctor.daemonreport import DaemonReport, ask_daemon
from mkdaemon.cli.systemcommands import CommandOutput, run_command
from mkdaemon.clock import kernel_synchronised
from mkdaemon.config.root import Config
from mkdaemon.files import user_name

PTY_MAKER: Final = frozenset({"/dev/ptmx", "/dev/pts/ptmx"})
"""What a program has open that made a pseudo terminal; it may keep both ends."""
GUARD: Final = ("mkdaemon", "guard.py")
"""Last parts of the program that the guard runs."""
_LISTENS: Final = "0A"
"""State of a listening socket; proc(5), /proc/net/tcp."""
_LONGEST: Final = 1_000_000
"""Of a file of the kernel that is read [bytes]."""


class Process(NamedTuple):
    """A running program.

    Attributes:
        number: its process id.
        name: as the kernel has it, 15 characters at most.
        words: its command line.
        files: what it has open, as far as this user may see it.
    """

    number: int
    name: str
    words: tuple[str, ...]
    files: frozenset[str]

    @property
    def is_daemon(self) -> bool:
        """It is `mkdaemon run`."""
        return "run" in self.words and any(Path(word).name == "mkdaemon" for word in self.words)

    @property
    def is_ours(self) -> bool:
        """It is the daemon, or its guard."""
        return self.is_daemon or any(Path(word).parts[-2:] == GUARD for word in self.words)

    def __str__(self) -> str:
        """Name and number, as a user looks for it; of a script the script's name."""
        words = [word for word in self.words if not word.startswith("-")]
        is_script = len(words) > 1 and Path(words[0]).name.startswith("python")
        name = Path(words[is_script]).name if words else self.name
        return f"{name} (process {self.number})"


class Listener(NamedTuple):
    """A socket that waits for connections.

    Attributes:
        port: its TCP port.
        inode: its number, by which a process that has it open is found.
    """

    port: int
    inode: str


def may_use(path: Path) -> bool:
    """Whether this user may read and write a file or folder."""
    return os.access(path, os.R_OK | os.W_OK)


def free_bytes(path: Path) -> int | None:
    """Free room on the disk of a file [bytes]; None if unknown."""
    try:
        found = os.statvfs(path)
    except OSError:
        return None
    return found.f_bavail * found.f_frsize


def installed_version(package: str) -> str | None:
    """Version of an installed package; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@dataclass(frozen=True)
class Machine:
    """Where the checks look.

    Attributes:
        root: of /dev, /proc, /sys, /run, /etc.
        run: runs a command.
        may_use: whether a file may be read and written.
        free_bytes: room that is left where a file lies [bytes].
        follows_server: whether the kernel says that the clock follows a time server; None where it cannot tell.
        wall: Unix time [s].
        installed_at: Unix time at which this program was installed [s].
        installed_version: of a Python package.
        user: who runs the doctor.
        ask: asks the daemon of a vehicle, at some endpoints, about itself.
    """

    root: Path = Path("/")
    run: Callable[[Sequence[str]], CommandOutput] = run_command
    may_use: Callable[[Path], bool] = may_use
    free_bytes: Callable[[Path], int | None] = free_bytes
    follows_server: Callable[[], bool | None] = kernel_synchronised
    wall: Callable[[], float] = time.time
    installed_at: float = field(default_factory=lambda: Path(__file__).stat().st_mtime)
    installed_version: Callable[[str], str | None] = installed_version
    user: str = field(default_factory=user_name)
    ask: Callable[[Config, Sequence[str]], DaemonReport] = ask_daemon

    def at(self, path: str) -> Path:
        """Where an absolute path of the system lies; a relative one is the user's own."""
        return self.root / path.removeprefix("/") if path.startswith("/") else Path(path)

    def shown(self, path: Path) -> str:
        """A path as the system calls it."""
        with suppress(ValueError):
            return f"/{path.relative_to(self.root)}"
        return str(path)

    def find(self, pattern: str) -> list[Path]:
        """Files and folders that match a pattern below the root, in order."""
        return sorted(self.root.glob(pattern))

    def read(self, path: Path | str) -> str:
        """What a file says, without the white space at its ends; empty where there is none.

        Args:
            path: where it lies, or as the system calls it in a text.
        """
        try:
            with (self.at(path) if isinstance(path, str) else path).open("rb") as file:
                return file.read(_LONGEST).decode(errors="replace").strip()
        except OSError:
            return ""

    def group_of(self, path: Path) -> str:
        """Group of a device: whose members may open it."""
        try:
            return grp.getgrgid(path.stat().st_gid).gr_name
        except (KeyError, OSError):
            return "dialout"

    @cached_property
    def processes(self) -> tuple[Process, ...]:
        """Every program that runs, but this one."""
        folders = [folder for folder in self.find("proc/[0-9]*") if int(folder.name) != os.getpid()]
        return tuple(sorted(filter(None, map(self._process, folders)), key=lambda process: process.number))

    def running(self, *names: str) -> Process | None:
        """The first process of one of these names; None where none runs."""
        return next((process for process in self.processes if process.name in names), None)

    def holders(self, path: Path) -> list[Process]:
        """Programs that have a device open or have locked it; the creator of a pseudo terminal is its other end."""
        shown, locked = self.shown(path.resolve()), self._locked_by(path)
        others = PTY_MAKER if shown.startswith("/dev/pts/") else frozenset()
        found = [process for process in self.processes if shown in process.files or process.number in locked]
        return [process for process in found if not process.files & others]

    @cached_property
    def listeners(self) -> tuple[Listener, ...]:
        """Every TCP socket that waits for connections."""
        return tuple(
            Listener(int(words[1].rpartition(":")[2], 16), words[9])
            for table in ("/proc/net/tcp", "/proc/net/tcp6")
            for words in map(str.split, self.read(table).splitlines()[1:])
            if len(words) > 9 and words[3] == _LISTENS
        )

    def _process(self, folder: Path) -> Process | None:
        name = self.read(folder / "comm")
        words = tuple(filter(None, self.read(folder / "cmdline").split("\0")))
        return Process(int(folder.name), name, words, frozenset(_links(folder / "fd"))) if name or words else None

    def _locked_by(self, path: Path) -> set[int]:
        """Processes that have locked a device: proc(5), /proc/locks, and the lock files of terminal programs."""
        found = set()
        lock = self.read(f"/run/lock/LCK..{path.resolve().name}")
        if lock.isdigit():
            found.add(int(lock))
        with suppress(OSError):
            state = path.stat()
            place = f"{os.major(state.st_dev):02x}:{os.minor(state.st_dev):02x}:{state.st_ino}"
            for line in self.read("/proc/locks").splitlines():
                words = line.split()
                if place in words[4:]:
                    found |= {int(word) for word in words[4:5] if word.isdigit()}
        return found


def _links(folder: Path) -> Iterator[str]:
    """What the links in a folder point to, as far as this user may see it."""
    try:
        links = list(folder.iterdir())
    except OSError:
        return
    for link in links:
        with suppress(OSError):
            yield str(link.readlink())
