"""The menus of the boards: pages of 4 lines of 20 characters, turned with keys. Texts are our own.

Source: docs/protocol.md, "Common commands" (keys, page numbers); docs/firmware-notes for what a page too high gives.
"""

from __future__ import annotations

from typing import Final

from mkdaemon.protocol.flags import MenuKey
from mkdaemon.protocol.messages import Display, DisplayOld
from mkdaemon.protocol.wire import WireMessage

_COLUMNS: Final = 20
_LINES: Final = 4
_NEW_FORMAT: Final = 0x80
_OLD_LINE: Final = 2
_REFUSAL: Final = "!!! INCOMPATIBLE !!!"


def compose(page: int, *lines: str) -> str:
    """Lay lines out, the page number in brackets at the end of the first."""
    number = f"[{page}]"
    first = (lines[0] if lines else "")[: _COLUMNS - len(number)]
    rows = [first.ljust(_COLUMNS - len(number)) + number, *lines[1:]]
    rows += [""] * (_LINES - len(rows))
    return "".join(row[:_COLUMNS].ljust(_COLUMNS) for row in rows[:_LINES])


class MenuPages:
    """Keys and the page shown; shared by both boards.

    Attributes:
        last: number of the last page.
        shown: number of the page shown.
    """

    def __init__(self, last: int) -> None:
        self.last = last
        self.shown = 0
        self._obsolete = False

    def turn(self, keys_inverted: int) -> MenuKey:
        """Obey the page keys; return the others."""
        self._obsolete = not keys_inverted & _NEW_FORMAT
        keys = MenuKey(~keys_inverted & 0x0F)
        both = MenuKey.PREVIOUS_PAGE | MenuKey.NEXT_PAGE
        if self._obsolete or not keys:
            return MenuKey.NONE
        if keys & both == both:
            self.shown = 0
        elif keys & MenuKey.PREVIOUS_PAGE:
            self.shown = self.shown - 1 if self.shown else self.last
        elif keys & MenuKey.NEXT_PAGE:
            self.shown = self.shown + 1 if self.shown < self.last else 0
        return keys & ~both

    def wrap(self, text: str) -> WireMessage:
        """Build H in the format that was asked for."""
        if self._obsolete:
            return DisplayOld(line=_OLD_LINE, text=_REFUSAL)
        return Display(text=text)
