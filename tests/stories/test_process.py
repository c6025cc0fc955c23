"""A daemon process that is killed while a client flies, and started again."""

from __future__ import annotations

import pytest

from lab.attack.deaths import ControlLostError, Death, attack
from lab.rigs.cockpit import Boards
from lab.rigs.pilot import NotObeyedError
from tests.repeats import InconclusiveError


@pytest.mark.real_time(tolerance=0.1)
async def test_after_a_kill_the_next_start_begins_with_a_release_and_nobody_steers():
    try:
        found = await attack(Boards("2.08"), Death.RESTARTED, 2)
    except (ControlLostError, NotObeyedError) as why:
        raise InconclusiveError(str(why)) from why
    assert (found["words"], found["steered"], found["tracebacks"]) == ("release", 0, 0), found
