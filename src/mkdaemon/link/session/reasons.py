"""Words of the verdicts on a line: what was seen, and what to do where something can be done."""

from __future__ import annotations

from typing import Final

STUCK: Final = "the port takes no bytes: flow control stops it, or its reader hangs"
"""Reason of a stuck port."""
NOTHING: Final = "nothing arrives: check power, wiring and that this is the right port"
"""Reason of a line that never said anything."""
STOPPED: Final = "nothing arrives any more: the board was switched off, stands still, or a cable came off"
"""Reason of a line that was heard before."""
UNANSWERED: Final = "frames arrive, but nothing we send is answered: check the board's RX wire"
"""Reason of a one-way line."""
QUIET: Final = "nothing arrives, and for 6 s hardly anything is asked: the last release was not confirmed"
"""Reason of a mute line while requests would keep an old stick command alive."""
DAMAGED: Final = "frames arrive damaged, and nothing we send is answered"
"""Reason of a line on which only damage arrives beside a few frames."""
NO_FRAME: Final = "bytes arrive, but no frame: wrong baud rate, or a damaged line"
"""Reason of garbage."""
RESTARTING: Final = "a board has booted: its streams begin again"
"""Reason of streams that a boot has ended."""


def shorten(text: str) -> str:
    """One short line of a text that a board printed."""
    return " ".join(text.split())[:40]


def boots(text: bytes) -> str:
    """Reason of a silence after boot text."""
    return f'a board boots ("{shorten(text.decode("latin-1"))}"): it listens again in a few seconds'


def plain_text(text: str) -> str:
    """Reason of a line on which only text arrives."""
    return f'only plain text arrives ("{shorten(text)}"): the board boots, or prints something'


def stood_still(seconds: float) -> str:
    """Reason of what was missed while this program did not run."""
    return f"this program stood still for {seconds:.1f} s: the machine is busy, or something stopped it"
