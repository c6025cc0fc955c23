"""A seeded subset of `python -m lab procedures`; the whole of it is run there."""

from __future__ import annotations

import random

import pytest

from lab.procedures import HASTY, NOISE, POOR, UPLOAD_PATIENCE, run_backup, run_upload
from lab.rigs.grounded import GroundedAircraft
from lab.rigs.virtualline import Noise, VirtualLine
from mkdaemon.protocol.procedures import Patience
from mkdaemon.protocol.procedures.labels import read_labels
from mkdaemon.protocol.procedures.live_set import differing
from mkdaemon.protocol.procedures.settings_slots import restore_settings
from mkdaemon.protocol.wire import Board
from mksim.boards.flightctrl import FlightCtrl
from mksim.boards.generations import FC_GENERATIONS

FAIR = Noise(lost=0.0015, damaged=0.0015, stalled=0.01, longest_stall=1.0, repeated=0.01)
NAMED = {"verified", "RequestTimeoutError", "not_verified", "not_cleared", "point_refused"}


@pytest.mark.parametrize("seed", range(10))
def test_no_upload_over_a_bad_line_claims_what_is_not_so(seed: int) -> None:
    run = run_upload(seed, NOISE, UPLOAD_PATIENCE)
    assert not run["is_wrong"]
    assert run["end"] in NAMED


@pytest.mark.parametrize("seed", range(8))
def test_no_backup_claims_what_is_not_so_or_leaves_another_live_set(seed: int) -> None:
    run = run_backup(seed, POOR, HASTY)
    assert not run["is_wrong"]
    assert run["end"] in {"verified", "RequestTimeoutError", "live_set_unproven"}


def test_patience_brings_a_backup_through_a_bad_line() -> None:
    found = run_backup(2)
    assert (found["end"], found["is_wrong"]) == ("verified", False)


def test_the_same_seed_is_the_same_run() -> None:
    assert run_upload(5) == run_upload(5)


def test_a_clean_line_needs_no_second_request() -> None:
    run = run_backup(1, Noise(), Patience(1))
    # version, active set twice, four others twice, the proof, and which set is active
    assert (run["end"], run["asked"]) == ("verified", 1 + 2 + 4 * 2 + 2)


def board(seed: int = 1) -> FlightCtrl:
    return FlightCtrl(FC_GENERATIONS["2.12a"], GroundedAircraft(), seed=seed)


def test_labels_of_the_simulated_flightctrl_have_its_checksum() -> None:
    line = VirtualLine(board(), FAIR, random.Random(1))
    names = line.run(read_labels(Board.FC, Patience(10, 0.1)))
    assert len(names) == 32
    assert line.asked > 33


def test_restore_over_a_fair_line_reads_back_what_the_board_made_of_it() -> None:
    """The simulated FlightCtrl pulls gas_max (byte 27) up to 100 when it writes."""
    flight = board()
    line = VirtualLine(flight, FAIR, random.Random(3))
    wanted = flight.eeprom.sets[1][:27] + b"\x05" + flight.eeprom.sets[1][28:]
    done = line.run(restore_settings({1: wanted}, Patience(10, 0.2)))
    assert done.written == (1, 3)
    assert differing(wanted, done.stored[1]) == (27,)
    assert (done.stored[1][27], flight.eeprom.active) == (100, 3)
    assert flight.live.raw == flight.eeprom.sets[3]
