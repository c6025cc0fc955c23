"""The control path: numbers, confirmations, and those that could not be seen."""

from __future__ import annotations

import itertools
from functools import partial

import pytest

from lab.rigs.sticks import build_sticks
from mkdaemon.link.session.controlpath import ControlPath
from mkdaemon.link.session.health import HealthMonitor
from mkdaemon.link.session.traffic import Purpose
from mkdaemon.protocol.messages import ExternControlV2

STICKS = partial(build_sticks(ExternControlV2, pitch=10, throttle=50), ExternControlV2)


@pytest.fixture
def path() -> ControlPath:
    return ControlPath(HealthMonitor())


def send(path: ControlPath, now: float) -> int:
    entry = path.entry(STICKS, Purpose.SETPOINT, now + 0.1)
    path.sent(entry, now, confirms=True)
    return entry.number


def lost(path: ControlPath, now: float) -> int:
    path._health.confirm.expire(now)
    return path._health.confirm.statistics(now).lost_total


def test_numbers_roll_and_never_are_zero(path):
    numbers = [path.entry(STICKS, Purpose.SETPOINT, 1.0).number for _ in range(600)]
    assert set(numbers) == set(range(1, 256))
    assert all((b - a) % 255 == 1 for a, b in itertools.pairwise(numbers))


def test_the_last_command_is_remembered_until_the_port_is_lost(path):
    send(path, 0.0)
    assert path.last_command is not None
    assert path.last_command.pitch == 10
    path.restart()
    assert path.last_command is None


def test_a_confirmation_missing_beside_a_free_transmitter_is_a_loss(path):
    first, second = send(path, 0.0), send(path, 0.02)
    path.confirmed(second, 0.028)
    assert lost(path, 1.0) == 1
    assert path.hidden == 0
    assert first != second


def test_one_hidden_by_a_long_frame_is_none(path):
    send(path, 0.0)
    second = send(path, 0.01)
    path.board_was_busy(0.004, 0.021)
    path.confirmed(second, 0.023)
    assert lost(path, 1.0) == 0
    assert path.hidden == 1


def test_frames_on_end_are_one_stretch(path):
    send(path, 0.0)
    second = send(path, 0.02)
    path.board_was_busy(0.004, 0.021)
    path.board_was_busy(0.023, 0.030)
    path.confirmed(second, 0.032)
    assert path.hidden == 1


def test_a_short_frame_hides_nothing(path):
    send(path, 0.0)
    second = send(path, 0.02)
    path.board_was_busy(0.009, 0.013)
    path.confirmed(second, 0.029)
    assert path.hidden == 0
    assert lost(path, 1.0) == 1


def test_the_way_by_radio_is_taken_into_account(path):
    for n in range(20):
        path.confirmed(send(path, n * 0.1), n * 0.1 + 0.048)
    send(path, 10.0)
    second = send(path, 10.01)
    path.board_was_busy(10.044, 10.061)
    path.confirmed(second, 10.063)
    assert path.hidden == 1


def test_strange_confirmations_hide_nothing(path):
    send(path, 0.0)
    path.confirmed(99, 0.01)
    assert path.hidden == 0


def test_where_none_can_come_none_is_missed(path):
    path.sent(path.entry(STICKS, Purpose.RELEASE, 1.0), 0.0, confirms=False)
    assert path.last_command is None
    assert lost(path, 1.0) == 0
