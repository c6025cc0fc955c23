"""STATUSTEXT: pieces, what is not said twice, and that nothing grows."""

from __future__ import annotations

import pytest

from mkdaemon.gateways.mavlink.texts import INFO, WARNING, Texts


@pytest.mark.parametrize("length", [0, 1, 49, 50, 51, 99, 100, 101, 399, 400])
def test_pieces_come_together_again(length):
    text = "abcdefghij" * 40
    pieces = Texts().pieces(WARNING, text[:length], 0.0)
    assert "".join(piece.text for piece in pieces).removesuffix(" ") == text[:length]
    assert all(piece.text for piece in pieces) or not length  # QGroundControl shows an empty one as " ... "
    assert {piece.severity for piece in pieces} == {WARNING}
    if length > 50:
        assert len({piece.id for piece in pieces}) == 1 and pieces[0].id > 0
        assert [piece.chunk_seq for piece in pieces] == list(range(len(pieces)))
        assert len(pieces[-1].text) < 50  # the last one says that it is
    else:
        assert [piece.id for piece in pieces] == [0]


def test_other_letters_are_question_marks_a_longer_one_ends_in_dots_and_the_same_comes_again_only_later():
    assert Texts().pieces(INFO, "f\u00fcnf", 0.0)[0].text == "f?nf"
    words = "".join(piece.text for piece in Texts().pieces(INFO, "x" * 1000, 0.0))
    assert words == "x" * 397 + "... "
    texts = Texts()
    assert texts.pieces(INFO, "same", 0.0) and not texts.pieces(INFO, "same", 2.9)
    assert texts.pieces(INFO, "same", 1.0, to="another") and texts.pieces(INFO, "same", 3.1)
    for number in range(1000):
        texts.pieces(INFO, f"{number}", 5.0)
    assert len(texts._sent) == 64
