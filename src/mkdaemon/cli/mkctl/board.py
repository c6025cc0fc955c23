"""`mkctl board`: what the boards keep and do: mixer, motors, parameters, labels, menus, streams, any request."""

from __future__ import annotations

from typing import Final

from cyclopts import App

BOARD: Final = {
    "mixer": "mkdaemon.cli.mkctl.mixer:app",
    "motors": "mkdaemon.cli.mkctl.motors:app",
    "motor-controllers": "mkdaemon.cli.mkctl.motor_controllers:app",
    "parameters": "mkdaemon.cli.mkctl.ncparam:app",
    "labels": "mkdaemon.cli.mkctl.streams:labels",
    "display": "mkdaemon.cli.mkctl.display:display",
    "rates": "mkdaemon.cli.mkctl.streams:rates",
    "send": "mkdaemon.cli.mkctl.send:app",
}
"""Commands and their functions or groups, each imported when it is used."""

app: Final = App(name="board", help="A board's own: mixer, motors, parameters, labels, display, rates, any request.")
for _name, _target in BOARD.items():
    app.command(_target, name=_name)
