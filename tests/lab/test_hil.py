"""The proving ground without a firmware: what it says then, its figures, and what it makes of sources and an EEPROM.

The firmware and simavr are the user's (docs/lab/genuine.md), so nothing here runs one.
"""

from __future__ import annotations

import math

import pytest

from lab.hil import build as building
from lab.hil.eeprom import SETTINGS, _checksum, _is_set
from lab.hil.flights import PAD_STARTS, SHORT, Flown, Setting, figures
from lab.hil.main import main, summary
from lab.hil.scenes import SCENES
from lab.hil.triggers import Flight, missed
from mkdaemon.errors import ConfigError
from mkdaemon.protocol.settings import ParameterSet, layout_of
from mksim.boards.parameters import factory_set

REPAIRED = """
static avr_cycle_count_t avr_eei_raise(
\tavr_raise_interrupt(p->io.avr, &p->ready);
\treturn 0;
\tif (eempe && avr_regbit_get(avr, p->eepe)) {\t// write operation
\t// autocleared
\tavr_regbit_clear(avr, p->eepe);
"""


@pytest.fixture
def unbuilt(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "FIRMWARE", tmp_path / "firmware")
    monkeypatch.setattr(building, "LIBRARY", tmp_path / "board.so")
    return tmp_path


def test_without_a_firmware_it_says_what_to_fetch_and_to_run(unbuilt, capsys):
    assert main() == 2
    said = capsys.readouterr().err
    assert "make hil FIRMWARE=" in said
    assert "buserror/simavr" in said
    assert "MikroKopterFlightController" in said


@pytest.mark.parametrize(
    ("missing", "words"), [("simavr", "no checkout of simavr"), ("sources", "no makefile of a FlightCtrl")]
)
def test_what_is_missing_for_building_is_named(unbuilt, monkeypatch, missing, words):
    monkeypatch.setattr(building.shutil, "which", lambda program: f"/usr/bin/{program}")
    header = unbuilt / "simavr" / "simavr" / "sim" / "sim_avr.h"
    if missing != "simavr":
        header.parent.mkdir(parents=True)
        header.touch()
    with pytest.raises(ConfigError, match=words):
        building.build(unbuilt / "fc", unbuilt / "simavr")


def test_a_compiler_that_is_not_there_is_named_with_its_package(unbuilt, monkeypatch):
    monkeypatch.setattr(building.shutil, "which", lambda program: None)
    with pytest.raises(ConfigError, match=r"apt-get install gcc-avr avr-libc"):
        building.build(unbuilt, unbuilt)


def test_another_simavr_is_not_repaired_blindly():
    assert "is_busy" in building._busy_eeprom(REPAIRED)
    with pytest.raises(ConfigError, match=r"not that of tag v1\.6"):
        building._busy_eeprom(REPAIRED.replace("write operation", "writing"))
    with pytest.raises(ConfigError, match=r"avr_twi\.c"):
        building._slow_i2c("nothing of it")


def test_the_lid_of_stock_firmware_takes_the_place_of_a_forks():
    line = b"     ChannelGas = ExternalControl.Gas;\n"
    assert building.OWN_LID.sub(building.STOCK_LID, line) == (
        b"     if(ExternalControl.Gas < ChannelGas) ChannelGas = ExternalControl.Gas;\n"
    )


def test_parameter_sets_are_found_in_an_eeprom_and_set_up_for_this_transmitter():
    layout = layout_of(106)
    raw = factory_set(106, 3)
    stored = bytearray(b"\xff" * 100 + raw + bytes((_checksum(raw),)) + b"\xff" * 50)
    assert [start for start in range(60, 130) if _is_set(stored, start, layout)] == [100]
    changed = ParameterSet.from_payload(raw).replaced(SETTINGS)
    assert changed["external_control"] == 255
    assert changed["receiver"] == 0


def flown(**more):
    """A flight that holds 3 cm beside its goal, and lands 2 cm from the middle."""
    truth = [(t / 100, 0.03, 0.0, 2.0, 0.0, 0.0) for t in range(2000)]
    truth += [(20 + t / 100, 0.02, 0.0, 0.1, -0.4, float(t > 50)) for t in range(100)]
    estimates = [(t / 50, 0.05, 0.0, 2.0, 0.02, 0.02, 0.02, 0.078, 0.0) for t in range(50, 1000)]
    return Flown(truth, estimates, [], {"take-off": 0.0, "hold": 1.0, "land": 20.0}, "landed on pad", "", **more)


def test_figures_of_a_flight():
    found = figures(flown())
    assert not found["lost"]
    assert found["hold_cm"] == pytest.approx(3.0)
    assert (found["touch_cm"], found["sink"]) == (pytest.approx(2.0), pytest.approx(0.4))
    assert found["nees_level"] == pytest.approx(0.5)
    assert found["filter_off_ms"] == pytest.approx(0.0, abs=0.01)
    assert found["false_lid"] == 0


def test_a_warning_of_a_lid_that_is_none_counts():
    record = flown()
    record.warnings.append((5.0, "the pilot's throttle (-40) caps ours: ..."))
    assert figures(record)["false_lid"] == 1


@pytest.mark.parametrize(
    ("change", "missed"),
    [
        ({}, []),
        ({"hold_cm": 4.0}, ["hold_cm: median at most 3.2"]),
        ({"false_lid": 1}, ["false_lid: worst at most 0"]),
        ({"touch_cm": math.nan}, ["touch_cm: p90 at most 6"]),
    ],
)
def test_goals_are_judged_by_what_they_name(change, missed):
    whole = figures(flown()) | {"light_cm": 5.0, "moderate_cm": 9.0, "step_t90": 1.5, "step_over_percent": 4.0}
    summed = summary(SCENES["cable"], [whole | change | {"seed": 1}])
    assert summed["missed"] == missed
    assert summed["holds"] is not missed
    assert summed["holds"] == (missed == [])


def test_every_scene_makes_a_setting_of_any_seed():
    for scene in SCENES.values():
        for seed in range(20):
            setting = scene.setting(None, seed)
            assert setting.seed == seed
            assert 12.0 < setting.voltage < 17.0
    assert Setting(None, SHORT, 1).pad_speed == 0.0
    assert PAD_STARTS > 20.0


def test_a_story_is_judged_by_what_the_firmware_held():
    flight = Flight.__new__(Flight)
    flight.held = [(1.0, (0, 0, 0, 90, True)), (2.0, (20, 0, 0, 90, True)), (2.5, (0, 0, 0, 90, True))]
    assert flight.level_after(2.2) == pytest.approx(0.3)
    assert flight.released_after(2.2) == math.inf
    flight.held.append((3.0, (0, 0, 0, 90, False)))
    assert flight.released_after(2.2) == pytest.approx(0.8)
    assert missed("client_frozen", {"level": 0.3, "released": 1.0}) == []
    assert missed("client_frozen", {"level": 0.6, "released": math.inf}) == [
        "level 0.60 is not in 0.25 to 0.45",
        "released inf is not in 0.9 to 1.35",
    ]
