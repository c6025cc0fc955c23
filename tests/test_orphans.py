"""What tests start ends with them, however they end, and however far away it was started."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from lab.rigs.waiting import wait_blocking
from tests.orphans import marked, no_orphans
from tests.places import ROOT

STARTS = f"""
import os, signal, subprocess, sys
sys.path.insert(0, {str(ROOT)!r})
from tests.orphans import no_orphans
sleeper = "import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])"
with no_orphans() as mark:
    command = [sys.executable, "-c", sleeper + "; time.sleep(600)"]
    subprocess.Popen(command, env=os.environ | mark, start_new_session=True, stdout=subprocess.DEVNULL)
    print(*mark.values(), flush=True)
    signal.pause()
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM], ids=lambda number: number.name)
def test_what_tests_started_ends_with_them_even_in_another_session(number):
    with subprocess.Popen([sys.executable, "-c", STARTS], stdout=subprocess.PIPE, text=True) as tests:
        value = tests.stdout.readline().strip()
        wait_blocking(lambda: len(marked(value)) == 2)
        tests.send_signal(number)
    wait_blocking(lambda: marked(value) == [])


def test_what_still_runs_at_the_end_of_the_tests_is_ended():
    with no_orphans() as mark:
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], env=mark)
    assert child.wait() == -signal.SIGKILL
