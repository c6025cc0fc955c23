"""Step 2 of docs/quickstart.md as a new user types it: every command as it stands there, in a shell."""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lab.places import ROOT
from lab.rigs.processes import connected
from lab.rigs.waiting import PATIENCE, wait_blocking
from tests.bus.support import free_endpoint
from tests.places import CONFIGS
from tests.repeats import InconclusiveError, require_no_standstill

pytestmark = [pytest.mark.flight, pytest.mark.real_time(tolerance=0.1)]

PROGRAMS = ("mkdaemon", "mkctl")
VEHICLE = "mk1"
PORT = "/dev/pts/N"
"""What stands on the page for the port that the simulator prints."""


def commands() -> list[str]:
    """The lines of the step's shell blocks."""
    page = (ROOT / "docs" / "quickstart.md").read_text(encoding="utf-8")
    step = page.split("\n## 2. ")[1].split("\n## 3. ")[0]
    return [line for block in re.findall(r"```sh\n(.*?)```", step, re.DOTALL) for line in block.splitlines()]


class Terminal:
    """A checkout whose daemon has a bus of its own, so that another daemon on this machine does not matter;
    it goes before the other programs of a busy machine."""

    def __init__(self, folder: Path) -> None:
        self.endpoint = endpoint = free_endpoint()
        sample = (CONFIGS / "sim.toml").read_text(encoding="utf-8")
        (folder / "configs").mkdir()
        sample = sample.replace("tcp/127.0.0.1:7447", endpoint).replace("[control]", "[control]\nreal_time = true")
        (folder / "configs" / "sim.toml").write_text(sample)
        programs = folder / ".venv" / "bin"
        programs.mkdir(parents=True)
        for name in PROGRAMS:
            script = programs / name
            script.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m mkdaemon.cli.{name}.app "$@"\n')
            script.chmod(0o755)
        self._folder = folder
        self._environment = {**os.environ, "MK_CONNECT": endpoint, "PYTHONUNBUFFERED": "1"}

    @contextmanager
    def started(self, line: str) -> Iterator[subprocess.Popen[str]]:
        """A command that goes on until Ctrl-C, which ends it well."""
        pipe = subprocess.PIPE
        process = subprocess.Popen(
            f"exec {line}", shell=True, cwd=self._folder, env=self._environment, stdout=pipe, stderr=pipe, text=True
        )
        try:
            yield process
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
            process.communicate()

    def value(self, suffix: str, claim: Callable[[dict[str, Any]], bool] = bool) -> dict[str, Any]:
        """What another client gets under a key, as soon as a claim holds of it: no command is run again and again."""
        return asyncio.run(value_at(self.endpoint, suffix, claim))

    def run(self, line: str) -> str:
        """What a command printed; it must end well."""
        ended = subprocess.run(
            line,
            shell=True,
            cwd=self._folder,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        require_no_standstill(ended.stderr)
        if ended.stderr.startswith("mkctl: discovering: "):  # it was known before, and in flight no board is asked
            raise InconclusiveError("the daemon stood still for so long that the aircraft may be another one")
        if "nothing arrives any more" in ended.stderr:  # nothing else silences a pseudo terminal
            raise InconclusiveError("the simulator stood still")
        assert ended.returncode == 0, (line, ended.stdout, ended.stderr)
        return ended.stdout


async def value_at(endpoint: str, suffix: str, claim: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The last value under a key, as soon as a claim holds of it."""
    async with asyncio.timeout(PATIENCE), connected(endpoint, VEHICLE) as client:
        while not (value := await client.get(suffix)) or not claim(value.fields):  # noqa: ASYNC110 - asked again
            await asyncio.sleep(0.2)
    return value.fields


@pytest.mark.alone
def test_the_page_ends_with_sticks_that_fly(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path)
    simulate, run, status, watch, get_osd, start, get_position, show, stick, get_truth = commands()
    with terminal.started(simulate) as simulator:
        port = json.loads(simulator.stdout.readline())["port"]
        with terminal.started(run.replace(PORT, port)):
            terminal.value("link/state", lambda state: state["external_control"] == "v2")
            wait_blocking(lambda: "external control v2" in terminal.run(status), step=0.5)
            with terminal.started(watch) as watcher:
                assert watcher.stdout.readline().startswith("state/")
            assert terminal.run(get_osd).startswith("rx/nc/osd")
            terminal.value("sim/truth")  # the simulator joins the bus by itself, a second or two after the daemon
            terminal.run(start)
            terminal.value("state/position", lambda place: place["altitude_above_start"] > 1.7)
            assert height(terminal.run(get_position)) > 1.5
            assert "no client holds the lease" in terminal.run(show)
            before = terminal.value("sim/truth")["position_enu"]
            assert "setpoints; last stick frame: pitch 8," in terminal.run(stick)
            assert math.dist(terminal.value("sim/truth")["position_enu"][:2], before[:2]) > 0.5
            assert re.search(r"crashed\W+no", terminal.run(get_truth))


def height(shown: str) -> float:
    """Height above the start in what the command for the position shows [m]."""
    return float(re.search(r"altitude_above_start\W+([-0-9.]+)", shown)[1])
