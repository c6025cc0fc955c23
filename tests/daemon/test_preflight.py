"""What the daemon reads before a flight."""

from __future__ import annotations

import asyncio
import shutil

import pytest

from lab.rigs.blackbox import RecordedDaemon
from lab.rigs.boardport import ADAPTER_TIME
from lab.rigs.cockpit import Boards, cockpit
from mkdaemon.bus.codec import encode_map
from mkdaemon.config.root import Config
from mkdaemon.control.activeset import UNREAD
from mkdaemon.daemon import flight
from mkdaemon.daemon.preflight import active_set, free_disk
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.telemetry.control import Phase
from mkdaemon.telemetry.preflight import CheckState
from mkdaemon.virtualtime import run_virtually
from mksim.boards.parameters import factory_set

STILL = {"pitch": 0.0, "roll": 0.0, "yaw": 0.0, "throttle": 0.0}


def test_the_factory_set_says_what_the_checks_need():
    found = active_set(ParameterSet(factory_set(106, 3)))
    assert (found.name, found.is_known, found.has_height_control) == ("Easy", True, False)
    assert (found.emergency_throttle, found.emergency_time, found.low_cell) == (65, 90, pytest.approx(3.2))


def test_a_share_of_hover_is_no_throttle_and_the_voltage_of_a_pack_none_of_a_cell():
    parameters = ParameterSet(factory_set(106, 3))
    found = active_set(parameters.replaced({"global_config_3": 0x04, "low_voltage_warning": 132}))
    assert (found.emergency_throttle, found.low_cell) == (None, None)


def test_a_set_that_cannot_be_read_says_nothing():
    assert active_set(None) is UNREAD


def test_free_space_is_that_of_the_folder_that_will_be_made(tmp_path, monkeypatch):
    assert free_disk(tmp_path / "not" / "yet") == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.1)
    assert free_disk(None) is None

    def refuse(folder):
        raise PermissionError

    monkeypatch.setattr(shutil, "disk_usage", refuse)
    assert free_disk(tmp_path) is None


def test_the_disk_is_that_of_the_recordings(tmp_path, monkeypatch):
    looked = []
    monkeypatch.setattr(flight, "free_disk", lambda folder: looked.append(folder) or 5e9)
    sections = {"vehicle": {"name": "t", "state_folder": tmp_path / "state"}, "record": {"folder": tmp_path / "card"}}

    async def story():
        cfg = Config.model_validate({"link": {"port": "/dev/virtual"}, "bus": {"listen": ()}, **sections})
        daemon = RecordedDaemon(cfg, Boards("2.12a").make(1), seed=1, tick=ADAPTER_TIME)
        await daemon.begin()
        report = await daemon.wiring.flight.preflight()
        await daemon.stop()
        return report

    report = run_virtually(story())
    assert looked == [tmp_path / "card"]
    assert next(each for each in report.findings if each.name == "disk").state == "passed"


@pytest.mark.parametrize(("boards", "kind"), [(Boards("2.12a"), "passed"), (Boards("2.12a", "0.24"), "unknown")])
def test_the_active_set_is_read_for_the_checks_where_that_is_possible(boards, kind):
    async def story():
        async with cockpit(boards, seed=1) as flown:
            await asyncio.sleep(2.0)  # reception has been counted
            return await flown.flight.preflight()

    report = run_virtually(story())
    found = {each.name: each for each in report.findings}
    assert [
        each.token for each in report.findings if each.token not in (None, "emergency_falls", "cells_doubtful")
    ] == []
    assert found["gate"].state == found["height control"].state == kind
    assert found["firmware and layout"].state is CheckState.PASSED
    assert (found["emergency descent"].token == "emergency_falls") is (kind == "passed")


def test_in_flight_nothing_is_read():
    async def story():
        async with cockpit(Boards("2.12a"), seed=1) as flown:
            await flown.take("alice")
            for sequence in range(1, 120):
                setpoint = {"epoch": flown.epoch, "sequence": sequence, "ttl": 0.3, **STILL}
                flown.stream(encode_map(setpoint))
                await asyncio.sleep(0.02)
            assert flown.flight.phase is Phase.FLYING
            before = len(flown.sink.tx)
            report = await flown.flight.preflight()
            return report, flown.sink.tx[before:]

    report, sent = run_virtually(story())
    assert sent == []
    assert next(each for each in report.findings if each.name == "gate").state is CheckState.PASSED
