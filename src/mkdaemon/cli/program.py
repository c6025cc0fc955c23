"""What `mkctl` and `mkdaemon` share: lazily imported command tables, one-line errors, exit codes."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from typing import Final, NamedTuple, NoReturn

from cyclopts import App, CycloptsError

from mkdaemon.errors import ConfigError, MkError

EXIT_OK: Final = 0
EXIT_FAILURE: Final = 1
EXIT_CONFIG: Final = 2
EXIT_INTERRUPTED: Final = 130


class CommandEntry(NamedTuple):
    """One command of a table.

    Attributes:
        name: on the command line.
        target: `module:attribute` of a function or an `App`, imported when the command is used.
        help: one line shown in the list.
        group: heading it stands under.
    """

    name: str
    target: str
    help: str
    group: str = "Commands"


def build(name: str, about: str, table: Iterable[CommandEntry], *, chosen: str = "") -> App:
    """Make a program from its table. A command whose module is not installed is left out and breaks no other.

    Args:
        name: of the program.
        about: its own help.
        table: its commands.
        chosen: the command that is going to run: it shows its own, longer help in place of the table's line.
    """
    app = App(name=name, help=about, version=version("mkdaemon"), help_format="markdown")
    for entry in table:
        if importlib.util.find_spec(entry.target.partition(":")[0]) is not None:
            line = None if entry.name == chosen else entry.help
            app.command(entry.target, name=entry.name, help=line, group=entry.group)
    return app


def main(name: str, about: str, table: Iterable[CommandEntry]) -> NoReturn:
    """Run a program and end the process: 0 as asked, 1 failed while running, 2 wrong configuration or usage."""
    tokens = sys.argv[1:]
    sys.exit(run(build(name, about, table, chosen=tokens[0] if tokens else ""), tokens))


def run(app: App, tokens: Sequence[str] | None = None) -> int:
    """Run a program and return its exit code; every mistake is one line on stderr."""
    try:
        result = app(tokens, exit_on_error=False, result_action="return_value")
    except CycloptsError:
        return EXIT_CONFIG  # already explained
    except ConfigError as error:
        return _complain(app, error, EXIT_CONFIG)
    except MkError as error:
        return _complain(app, error, EXIT_FAILURE)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else EXIT_OK
    except BrokenPipeError:
        # Whoever read our output has gone; the interpreter must not try to flush to it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    return result if isinstance(result, int) else EXIT_OK


def _complain(app: App, error: MkError, code: int) -> int:
    print(f"{app.name[0]}: {' '.join(str(error).split())}", file=sys.stderr)
    return code
