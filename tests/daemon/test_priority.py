"""The loop's thread before all others, and nothing else; without the right to it everything runs on as before."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from mkdaemon.daemon.priority import (
    EYES,
    NICE,
    SWITCH,
    favour_eyes,
    favour_loop,
    favour_threads,
    is_favoured,
    treat_threads_equally,
)

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="this system has no such call")


@pytest.fixture(autouse=True)
def switch_interval():
    before = sys.getswitchinterval()
    yield
    sys.setswitchinterval(before)


def in_a_thread(act: Callable[[], object]) -> None:
    """Priorities belong to threads: let one that ends have them."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(act).result()


def policy() -> int:
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


def test_only_the_thread_that_asks_is_favoured():
    def act() -> None:
        allowed = favour_loop()
        assert policy() == (os.SCHED_RR if allowed else os.SCHED_OTHER)
        children: list[int] = []
        in_a_thread(lambda: children.append(policy()))
        assert children == [os.SCHED_OTHER]
        treat_threads_equally()
        assert policy() == os.SCHED_OTHER

    before = policy()
    in_a_thread(act)
    assert policy() == before
    assert sys.getswitchinterval() == pytest.approx(SWITCH)


def refuse(*_: object) -> None:
    raise PermissionError


@contextmanager
def waiting_threads(*names: str) -> Iterator[list[threading.Thread]]:
    done = threading.Event()
    threads = [threading.Thread(target=done.wait, name=name) for name in names]
    for thread in threads:
        thread.start()
    try:
        yield threads
    finally:
        done.set()
        for thread in threads:
            thread.join()


@pytest.mark.parametrize(("call", "favour"), [("sched_setscheduler", favour_loop), ("setpriority", favour_threads)])
def test_without_the_right_threads_stay_ordinary(monkeypatch, call, favour):
    monkeypatch.setattr(os, call, refuse)
    with waiting_threads("other"):
        assert favour() is False
    assert favour is favour_threads or sys.getswitchinterval() == pytest.approx(SWITCH)


def test_a_system_without_such_priorities_is_no_fault(monkeypatch):
    monkeypatch.delattr(os, "sched_setscheduler")
    assert favour_loop() is False
    assert favour_eyes() is False
    treat_threads_equally()
    assert sys.getswitchinterval() == pytest.approx(SWITCH)


def test_other_threads_go_before_other_programs():
    with waiting_threads("other") as (other,):
        own = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
        allowed = favour_threads()
        assert os.getpriority(os.PRIO_PROCESS, other.native_id) == (NICE if allowed else own)
        assert os.getpriority(os.PRIO_PROCESS, threading.get_native_id()) == own


def policy_of(thread: threading.Thread) -> int:
    assert thread.native_id is not None
    return os.sched_getscheduler(thread.native_id) & ~os.SCHED_RESET_ON_FORK


def test_the_eyes_go_with_the_loop_and_no_other_thread_does(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {0, 1})
    with waiting_threads(EYES, "recorder") as (eyes, other):
        allowed = favour_eyes()
        assert policy_of(eyes) == (os.SCHED_RR if allowed else os.SCHED_OTHER)
        assert policy_of(other) == os.SCHED_OTHER
        treat_threads_equally()
        assert policy_of(eyes) == os.SCHED_OTHER
    assert favour_eyes() is False


@pytest.mark.parametrize(
    ("wanted", "environment", "favoured"),
    [
        (None, {}, False),
        (None, {"NOTIFY_SOCKET": "/run/systemd/notify"}, True),
        (True, {}, True),
        (False, {"NOTIFY_SOCKET": "/run/systemd/notify"}, False),
    ],
)
def test_outside_a_service_priority_is_for_who_asks(wanted, environment, favoured):
    assert is_favoured(wanted, environment) is favoured
