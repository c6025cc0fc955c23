"""`mkctl board`: what the boards keep and do: mixer, motors, parameters, labels, menus, streams, any request."""

from __future__ import annotations

from typing import Final

from cyclopts import App

from mkdaemon.cli.mkctl.commands import BOARD

app: Final = App(name="board", help="A board's own: mixer, motors, parameters, labels, display, rates, any request.")
for _name, _target in BOARD.items():
    app.command(_target, name=_name)
