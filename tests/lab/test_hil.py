"""The proving ground without a firmware: what it says then, its figures, and what it makes of sources and an EEPROM.

The firmware and simavr are the user's (docs/lab/genuine.md), so nothing here runs one.
"""

from __future__ import annotations

import asyncio
import ctypes
import ctypes.util
import json
import math

import pytest

from lab.hil import build as building
from lab.hil import chip, endings, rooms
from lab.hil.chip import SETTINGS, _checksum, _is_set
from lab.hil.flights import VOLTAGES, Flown, Setting, aircraft_of, config_of, figures, setting_of
from lab.hil.main import main
from lab.hil.processes import aside, in_a_copy
from lab.hil.scenes import summary
from lab.hil.triggers import Flight, missed, story_figures
from mkdaemon.errors import ConfigError
from mkdaemon.protocol.settings import ParameterSet, layout_of
from mkdaemon.virtualtime import run_virtually
from mksim.boards.parameters import factory_set
from mksim.scene.camera import deck_of
from mksim.scene.room import AWAY

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


def test_without_a_firmware_it_says_what_to_fetch_and_to_run(unbuilt):
    with pytest.raises(ConfigError) as said:
        main()
    for words in ("make hil FIRMWARE=", "buserror/simavr", "MikroKopterFlightController"):
        assert words in str(said.value)


@pytest.mark.parametrize(
    ("missing", "words"), [("simavr", "no checkout of simavr"), ("sources", "no makefile of a FlightCtrl")]
)
def test_what_is_missing_for_building_is_named(unbuilt, missing, words):
    header = unbuilt / "simavr" / "simavr" / "sim" / "sim_avr.h"
    if missing != "simavr":
        header.parent.mkdir(parents=True)
        header.touch()
    with pytest.raises(ConfigError, match=words):
        building.build(unbuilt / "fc", unbuilt / "simavr")


def test_a_compiler_that_is_not_there_is_named_with_its_package():
    with pytest.raises(ConfigError, match=r"avr-none is not installed: apt-get install gcc-avr avr-libc"):
        building.run_tool(["avr-none"], "the firmware")


def test_another_simavr_is_not_repaired_blindly():
    assert "is_busy" in building.repaired("avr_eeprom.c", REPAIRED)
    with pytest.raises(ConfigError, match=r"not that of tag v1\.6"):
        building.repaired("avr_eeprom.c", REPAIRED.replace("write operation", "writing"))
    for name in building.REPAIRS:
        with pytest.raises(ConfigError, match=name):
            building.repaired(name, "nothing of it")


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
    """A flight that holds 3 cm beside its goal, and lands on the pad that moves, 2 cm from the middle."""
    truth = [(t / 100, 0.03, 0.0, 2.0, 0.0) for t in range(2000)]
    truth += [(20 + t / 100, 0.02, 0.0, 0.1, float(t > 50)) for t in range(100)]
    estimates = [(t / 50, 0.05, 0.0, 2.0, 0.02, 0.02, 0.02) for t in range(50, 1000)]
    parts = {"take-off": 0.0, "hold": 1.0, "light": 8.0, "follow": 14.0, "land": 20.0}
    return Flown(truth, estimates, [], parts, "landed on pad", "", **more)


def test_figures_of_a_flight():
    found = figures(flown())
    assert found["lost"] == []
    assert found["hold_cm"] == found["light_cm"] == pytest.approx(3.0)
    assert found["moving_touch_cm"] == pytest.approx(2.0)
    assert found["nees_level"] == pytest.approx(0.5)
    assert found["warnings"] == []
    assert "step_t90" not in found


def test_figures_of_copies():
    rows = [(t / 100, min(-0.5 + t / 200, 0.55), 0.0, 2.0, 0.0) for t in range(600)]
    found = figures(Flown(rows, parts={"step": 0.0}))
    assert found["step_t90"] == pytest.approx(1.81)
    assert found["step_over_percent"] == pytest.approx(5.0)
    assert found["lost"] == []
    assert figures(Flown(rows, parts={"land": 0.0}))["lost"] == ["it did not land: it is in the air at the end"]
    assert figures(Flown(rows, parts={"moderate": 0.0}, end="sight lost"))["lost"] == ["sight lost"]
    assert figures(Flown(rows, parts={"moderate": 0.0}, crashed="hit the ground"))["lost"] == ["hit the ground"]


def test_a_landing_that_only_the_daemon_claims_is_lost():
    """The aircraft is in the air all along, beside the target, or its motors run."""
    record = flown()
    record.truth = [(*row[:4], 0.0) for row in record.truth]
    assert figures(record)["lost"] == ["it did not land: landed on pad"]
    record = flown()
    record.truth = [(at, 0.5, *rest) for at, _, *rest in record.truth]
    assert figures(record)["lost"] == ["it stands 50 cm from the middle of the target"]
    record = flown()
    record.motors_run = True
    assert figures(record)["lost"] == ["its motors run on the ground"]


def test_a_landing_whose_end_the_daemon_words_otherwise_is_none_the_less_one():
    record = flown()
    record.end = "the link went down"
    assert figures(record)["lost"] == []


def test_a_step_that_is_never_flown_is_lost():
    rows = [(t / 100, -0.5, 0.0, 2.0, 0.0) for t in range(600)]
    assert figures(Flown(rows, parts={"step": 0.0}))["lost"] == ["nine tenths of the step were never reached"]


def test_warnings_count_from_the_take_off_on_in_every_scene():
    record = flown()
    record.parts = {name: at + 1.0 for name, at in record.parts.items()}
    record.warnings += [(0.5, "on the ground"), (1.5, "in the take-off"), (5.0, "caps ours: ...")]
    assert figures(record)["warnings"] == ["in the take-off", "caps ours: ..."]
    scene = Flown(record.truth, warnings=record.warnings, parts={"moderate": 0.0})
    assert figures(scene)["warnings"] == ["on the ground", "in the take-off", "caps ours: ..."]


@pytest.mark.parametrize(
    ("line", "change", "missed"),
    [
        ("cable", {}, []),
        ("cable", {"hold_cm": 4.0}, ["hold_cm"]),
        ("radio", {"hold_cm": 4.0}, []),
        ("cable", {"warnings": ["the pilot's throttle (-40) caps ours"]}, ["false_warnings"]),
        ("radio", {"warnings": ["/dev/ttyUSB0: degraded: fc attitude is overdue: asked every 0.03 s"]}, []),
        ("cable", {"warnings": ["/dev/ttyUSB0: degraded: fc attitude is overdue"]}, ["false_warnings"]),
        ("radio", {"nees_height": 0.2}, ["nees_height"]),
        ("cable", {"step_t90": None}, ["step_t90"]),
    ],
)
def test_goals_are_judged_by_what_they_name(line, change, missed):
    copies = {"moderate_cm": 9.0, "step_t90": 1.5, "step_over_percent": 3.0, "touch_cm": 2.0}
    whole = figures(flown()) | copies | {"nees_level": 1.0, "nees_height": 1.0, "seed": 1}
    assert summary(line, [whole])["missed"] == []
    summed = summary(line, [whole | change])
    assert summed["missed"] == missed
    assert summed["holds"] is not bool(missed)
    assert summary(line, [whole | {"lost": ["fell"]}])["unfinished"] == ["1: lost: fell"]


def test_every_seed_makes_another_setting():
    settings = [setting_of("simulated", "radio", seed) for seed in range(40)]
    assert {setting.voltage for setting in settings} == set(VOLTAGES)
    assert {setting.has_compass for setting in settings} == {True, False}
    assert all(setting.board == "simulated" and setting.is_radio for setting in settings)
    assert len({setting.yaw for setting in settings}) == 40
    other = setting_of("simulated", "cable", 3)
    assert setting_of("genuine", "cable", 3) == Setting(
        "genuine", 3, False, other.voltage, other.has_compass, other.yaw
    )


def test_a_copy_goes_on_and_changes_nothing_here(capfd):
    told = run_virtually(_copied())
    assert told == [{"at": 2.0}, None, 1.0]
    assert "ZeroDivisionError" in capfd.readouterr().err


async def _copied():
    loop = asyncio.get_running_loop()
    await asyncio.sleep(1.0 - loop.time())

    async def work():
        await asyncio.sleep(1.0)
        return {"at": loop.time()}

    async def fail():
        return {"never": 1 / 0}

    return [await in_a_copy(work), await in_a_copy(fail), loop.time()]


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


def test_figures_of_a_story_over_all_flights():
    found = [{"level": 0.3, "missed": []}, {"level": None, "missed": ["level"]}, {"level": 0.4, "missed": []}]
    assert list(story_figures("client_frozen", found)) == [("level", "0.30 / 0.40 / never", "0.25 to 0.45")]


def test_a_library_of_older_sources_says_to_build_it_anew(monkeypatch):
    monkeypatch.setattr(chip, "LIBRARY", ctypes.util.find_library("c"))
    with pytest.raises(ConfigError, match=r"older sources .*make hil .* once more"):
        chip._load()


def test_what_a_library_prints_while_a_firmware_is_loaded_does_not_come_between_json(capfd):
    c = ctypes.CDLL(None)
    print("before")
    with aside():
        c.puts(b"Loaded 100 .text at address 0x0")
    print("after", flush=True)
    said = capfd.readouterr()
    assert said.out == "before\nafter\n"
    assert "Loaded" in said.err


def test_flights_are_counted_by_how_they_ended_and_a_release_fails(capsys):
    good = {"board": "fc", "line": "cable", "seed": 1, "ending": "finished", "why": "", "touch_cm": 3.0}
    bad = good | {"seed": 2, "ending": "released", "why": "no image of pad for 3.0 s"}
    assert endings.show([good], as_json=True) == 0
    capsys.readouterr()
    assert endings.show([good, bad], as_json=True) == 1
    [row] = json.loads(capsys.readouterr().out)["rows"]
    assert (row["finished"], row["released"]) == (1, 1)
    assert row["unfinished"] == ["2: released: no image of pad for 3.0 s"]


def test_motors_that_run_on_the_ground_are_no_end_of_a_flight(monkeypatch):
    ends = {"ending": "finished", "why": "", "touch_cm": 3.0, "seconds": 60.0}
    monkeypatch.setattr(endings, "flown", lambda prepare, strayed: (None, dict(ends)))
    monkeypatch.setattr(endings, "motors_run", lambda aircraft: False)
    assert endings.fly(setting_of("simulated", "cable", 1)) == ends
    monkeypatch.setattr(endings, "motors_run", lambda aircraft: True)
    assert endings.fly(setting_of("simulated", "cable", 1))["ending"] == "lost"


def test_a_pad_is_tilted_and_its_low_edge_is_above_the_ground():
    config = config_of(setting_of("simulated", "radio", 3, loss=0.05, tilt_deg=12.0))
    pad = deck_of(config.scene.platform)
    assert pad.at(0.59, 0.0, 0.0)[0] >= 0.0
    assert pad.at(-0.5, 0.0, 0.0)[0] - pad.at(0.5, 0.0, 0.0)[0] == pytest.approx(math.tan(math.radians(12.0)))
    assert (config.radio.to_board.loss, config.radio.to_host.loss) == (0.05, 0.05)


def test_flights_through_a_room_are_summed_up_and_asked_for_their_goals(capsys):
    row = {"case": "room", "board": "fw", "line": "cable", "seed": 1, "ending": "finished", "why": ""}
    row |= {"touch_cm": 3.0, "hold_cm": 4.0, "midway_cm": 5.0, "eight_cm": 6.0}
    for change, code in (
        ({}, 0),
        ({"touch_cm": 7.0}, 1),
        ({"eight_cm": 11.0}, 1),
        ({"eight_cm": None}, 1),
        ({"ending": "released", "why": "no target in sight"}, 1),
    ):
        assert rooms.show([row | change], as_json=True) == code
        found = json.loads(capsys.readouterr().out)["rows"][0]
        assert (found["board"], found["flights"]) == ("fw", 1)
    row = row | {"case": "paths", "rms_cm": 10.1, "most_cm": 20.0}
    assert rooms.show([row], as_json=True) == 1
    assert rooms.show([row | {"rms_cm": 9.9}], as_json=True) == 0


def test_a_room_is_crossed_from_the_first_pad():
    setting = setting_of("simulated", "cable", 1)
    aircraft = aircraft_of(setting, config_of(setting), is_room=True)
    assert aircraft.world.truth.position_enu[:2].tolist() == [-AWAY, 0.0]
