"""Programs of a fleet: simulators, daemons, a router, a recorder, each a process; and what each has used."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from lab.rigs.processes import PROGRAM, Program, cpu_of

ROUTER: Final = ("-m", "lab.fleet.router")
RECEIVING: Final = "(rx: (worker_threads: 32))"
"""Zenoh's threads of a router that receive: docs/operations.md."""


def say(words: str) -> None:
    """Tell who waits how far it is."""
    print(f"{time.strftime('%H:%M:%S')} {words}", file=sys.stderr, flush=True)


class Member(Program):
    """One process of a fleet, and what it has used with those it has started."""

    def family(self) -> list[int]:
        """It and the processes it has started: a daemon and its guard."""
        found = [self.pid]
        for task in Path(f"/proc/{self.pid}/task").iterdir():
            found += [int(word) for word in (task / "children").read_text(encoding="ascii").split()]
        return found

    def cpu_s(self) -> float:
        """Processor time that it and what it has started have used [s]."""
        return sum(cpu_of(pid) for pid in self.family())

    def own_mb(self) -> float:
        """Memory that would be free without it and what it has started: its share of what others use too [MiB]."""
        return sum(_share_kb(pid) for pid in self.family()) / 1024


def _share_kb(pid: int) -> int:
    """`Pss` of a process [KiB]: a page that n processes use counts for each as 1/n."""
    rolled = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    return int(rolled.partition("\nPss:")[2].split()[0])


@dataclass
class Aircraft:
    """A simulated aircraft and its daemon.

    Attributes:
        folder: of its files.
        simulator: its boards.
        daemon: its daemon.
    """

    folder: Path
    simulator: Member
    daemon: Member

    @classmethod
    async def start(
        cls, name: str, folder: Path, port: int, *, router: str, listen: Sequence[str], prefix: Sequence[str] = ()
    ) -> Self:
        """Start both, each with a `prefix` of its command line.

        Args:
            name: of the vehicle.
            folder: made, and filled with its configuration, its notes and its black box.
            port: TCP port of 127.0.0.1 on which its boards are reached.
            router: endpoint of the router.
            listen: where its bus listens itself.
        """
        boards, config = _written(name, folder, vehicle_config(name, folder, port, router, listen))
        words = (*PROGRAM, "sim", "--config", str(boards), "--pilot", "nothing", "--vehicle", name)
        simulator = await Member.start(*words, "--listen", f"127.0.0.1:{port}", prefix=prefix)
        await simulator.first_line()
        daemon = await Member.start(*PROGRAM, "run", "--config", str(config), "--log", "warning", prefix=prefix)
        return cls(folder, simulator, daemon)

    @property
    def recordings(self) -> list[Path]:
        """Its black box."""
        return sorted(self.folder.glob("state/**/*.mcap"))

    async def end(self) -> int:
        """End both in order; returns the exit code of the daemon."""
        code = await self.daemon.end()
        await self.simulator.end(signal.SIGINT)
        return code


def _written(name: str, folder: Path, config: str) -> tuple[Path, Path]:
    """Configuration files of a simulator and a daemon."""
    folder.mkdir()
    boards, vehicle = folder / "sim.toml", folder / f"{name}.toml"
    boards.write_text("[sim]\nconnect = []\n", encoding="utf-8")
    vehicle.write_text(config, encoding="utf-8")
    return boards, vehicle


def vehicle_config(name: str, folder: Path, port: int, router: str, listen: Sequence[str]) -> str:
    """The configuration file of a vehicle behind a router."""
    return (
        f'[vehicle]\nname = "{name}"\nstate_folder = "{folder}/state"\n'
        f'[link]\nport = "tcp:127.0.0.1:{port}"\n'
        f'[bus]\nlisten = [{", ".join(f"{one!r}" for one in listen)}]\nconnect = ["{router}"]\n'
    )
