"""Who is on the wire: proof by version replies, and when it is void."""

from __future__ import annotations

import pytest

from mkdaemon.link.session.peers import PROOF_AGE, Peers, Proof
from mkdaemon.protocol.messages import VersionFc210
from mkdaemon.protocol.wire import Board

VERSION = VersionFc210.decode(bytes([2, 12, 11, 0xBA, 0, 0, 0, 22, 103, 1]))


@pytest.fixture
def peers():
    return Peers()


def test_a_version_reply_proves_its_sender_until_it_is_old(peers):
    assert peers.proof is None
    assert not peers.is_proven(Board.FC, 0.0)
    peers.version_received(Board.FC, VERSION, 10.0)
    assert peers.proof == Proof(Board.FC, 10.0)
    assert peers.is_proven(Board.FC, 10.0 + PROOF_AGE)
    assert not peers.is_proven(Board.FC, 10.0 + PROOF_AGE + 0.01)
    assert not peers.is_proven(Board.NC, 10.0)


def test_a_redirection_voids_the_proof_but_not_what_is_known_of_the_firmware(peers):
    peers.version_received(Board.FC, VERSION, 10.0)
    peers.redirect(Board.FC, 10.0)
    assert not peers.is_proven(Board.FC, 10.0)
    assert peers.firmware == {Board.FC: str(VERSION.release)}
    peers.version_received(Board.FC, VERSION, 11.0)
    peers.redirect(None, 11.5)
    assert not peers.is_proven(Board.FC, 11.0)


def test_another_opening_of_the_port_voids_everything_that_was_heard(peers):
    peers.note_sender(Board.FC)
    peers.version_received(Board.FC, VERSION, 10.0)
    peers.restart()
    assert (peers.direct, peers.boards, peers.firmware, peers.proof) == (Board.ANY, set(), {}, None)


@pytest.mark.parametrize("board", [Board.BL, Board.MAG])
def test_a_board_that_is_no_pilot_is_not_where_the_wire_ends(peers, board):
    assert not peers.note_sender(board)
    assert (peers.direct, peers.boards) == (Board.ANY, set())


def test_a_silence_while_the_wire_was_passed_through_tells_nothing_about_the_boards(peers):
    peers.redirect(None, 0.5)  # it had not begun
    assert not peers.caused_silence(0.1, 2.0)
    peers.redirect(Board.FC, 10.0)
    peers.redirect(None, 15.0)
    assert peers.caused_silence(10.4, 15.5)
    assert not peers.caused_silence(9.0, 15.5)
    assert not peers.caused_silence(16.0, 17.5)


def test_what_boards_said_of_themselves_can_be_forgotten_behind_an_open_port(peers):
    peers.note_sender(Board.FC)
    peers.version_received(Board.FC, VERSION, 10.0)
    assert peers.learn(Board.FC, VERSION)
    assert peers.dialect.extern_control is not None
    peers.forget()
    assert peers.dialect.extern_control is None
    assert (peers.direct, peers.firmware, peers.proof) == (Board.FC, {}, None)


def test_a_flightctrl_that_speaks_after_its_navictrl_is_behind_it(peers):
    assert peers.note_sender(Board.NC)
    assert not peers.note_sender(Board.FC)
    assert (peers.direct, peers.boards) == (Board.NC, {Board.FC, Board.NC})


def test_looks_behind_a_navictrl_are_counted_on_for_a_flightctrl_that_never_named_itself(peers):
    peers.looks = 3
    peers.forget_flightctrl()
    assert peers.looks == 3
    peers.version_received(Board.FC, VERSION, 0.0)
    peers.forget_flightctrl()
    assert peers.looks == 0
