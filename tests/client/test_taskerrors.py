"""The error of a task is raised without its group; a defect is not."""

from __future__ import annotations

import asyncio

import pytest

from mkdaemon.client.taskerrors import single_error
from mkdaemon.errors import ConfigError, MkError


async def fail(error):
    raise error


async def test_the_error_of_a_task_in_groups_of_groups_is_raised_alone():
    with pytest.raises(ConfigError, match="no such key"), single_error():
        async with asyncio.TaskGroup() as outer:
            async with asyncio.TaskGroup() as inner:
                inner.create_task(fail(ConfigError("no such key")))
            outer.create_task(asyncio.sleep(0))


def test_a_defect_keeps_its_group():
    with pytest.raises(ExceptionGroup) as caught, single_error():
        raise ExceptionGroup("tasks", [MkError("unplugged"), RuntimeError("a defect")])
    assert len(caught.value.exceptions) == 2
