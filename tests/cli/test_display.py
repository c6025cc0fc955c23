from __future__ import annotations

from mkdaemon.cli.keyreader import QUIT
from mkdaemon.cli.mkctl.display import KEYS, lines_of
from mkdaemon.protocol.flags import MenuKey


def test_a_picture_is_four_lines_of_twenty() -> None:
    assert lines_of("A" * 20 + "B" * 20 + "C" * 20 + "D" * 20) == ["A" * 20, "B" * 20, "C" * 20, "D" * 20]
    assert [len(line) for line in lines_of("short")] == [20] * 4


def test_nothing_a_terminal_would_act_on_is_printed() -> None:
    assert lines_of("\x1b[2Jx\0y")[0] == " [2Jx y" + " " * 13


def test_keys_do_not_leave_and_leaving_is_no_key() -> None:
    assert not QUIT & KEYS.keys()
    assert KEYS["0"] == MenuKey.PREVIOUS_PAGE | MenuKey.NEXT_PAGE
