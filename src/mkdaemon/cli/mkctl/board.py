"""`mkctl board`: what the boards keep and do: mixer, motors, parameters, labels, menus, streams, any request."""

from __future__ import annotations

from typing import Final

from cyclopts import App

from mkdaemon.cli.mkctl.commands import BOARD

app: Final = App(name="board", help="Requests to a board: mixer, motors, parameters, labels, display, rates, others.")
for _name, _target in BOARD.items():
    app.command(_target, name=_name)
