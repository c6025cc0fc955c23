"""A daemon process that is killed while a client flies."""

from __future__ import annotations

import signal

import pytest

from lab.rigs.pilot import NotObeyedError
from lab.stories.kill import end_daemon
from tests.repeats import InconclusiveError


@pytest.mark.real_time(tolerance=0.1)
async def test_after_a_kill_the_next_start_begins_with_a_release_and_nobody_steers():
    try:
        end = await end_daemon("2.08", signal.SIGKILL, seed=1)
    except NotObeyedError as why:
        raise InconclusiveError(str(why)) from why
    assert (end["is_wrong"], end["exit_code"]) == (False, signal.SIGKILL), end
