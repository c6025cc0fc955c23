"""The clock of virtual time jumps only where nothing is to be done."""

from __future__ import annotations

import asyncio
import os
import threading

import pytest

from mkdaemon.virtualtime import run_virtually


def test_time_jumps_to_the_next_timer():
    async def main():
        await asyncio.sleep(3600.0)
        return asyncio.get_running_loop().time()

    assert run_virtually(main()) == 3600.0


def test_what_another_thread_wants_is_done_before_time_passes():
    async def main():
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        thread = threading.Thread(target=lambda: loop.call_soon_threadsafe(done.set_result, None))
        timer = loop.call_later(1.0, done.cancel)
        thread.start()
        thread.join()
        await done
        timer.cancel()
        return loop.time()

    assert run_virtually(main()) == 0.0


def test_a_file_that_can_be_read_is_read_before_time_passes():
    reading, writing = os.pipe()

    async def main():
        loop, seen = asyncio.get_running_loop(), []
        loop.add_reader(reading, lambda: seen.append((loop.time(), os.read(reading, 1))))
        loop.call_later(1.0, os.write, writing, b"x")
        await asyncio.sleep(2.0)
        loop.remove_reader(reading)
        return seen

    assert run_virtually(main()) == [(1.0, b"x")]
    os.close(reading)
    os.close(writing)


def test_waiting_for_what_never_comes_is_an_error():
    async def main():
        await asyncio.get_running_loop().create_future()

    with pytest.raises(RuntimeError, match="everything waits"):
        run_virtually(main())


def test_what_still_runs_at_the_end_has_the_time_to_leave():
    left = []

    async def leave_slowly():
        try:
            await asyncio.sleep(3600.0)
        finally:
            await asyncio.sleep(1.0)
            left.append(asyncio.get_running_loop().time())

    async def main():
        task = asyncio.create_task(leave_slowly())
        await asyncio.sleep(5.0)
        return task

    assert run_virtually(main()).done()
    assert left == [6.0]
