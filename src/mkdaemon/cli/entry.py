"""Entry points of the installed programs: Ctrl-C ends them from the first moment, silently, while they still import."""

# Built into the interpreter: importing `signal` itself takes long enough for an interrupt to show a traceback.
import _signal  # type: ignore[import-not-found]

_signal.signal(_signal.SIGINT, _signal.SIG_DFL)

import gc  # noqa: E402
import os  # noqa: E402
import sys  # noqa: E402

from mkdaemon.cli.listing import CommandEntry, asks_for_list, list_lines, print_help  # noqa: E402
from mkdaemon.cli.storedhelp import stored_help  # noqa: E402

# Nothing that is imported becomes garbage: the collector would look through it a hundred times. `program.main` enables
# it when the command's modules are there.
gc.disable()

# Pydantic looks through every installed package for a plugin; nothing here uses one.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def mkdaemon() -> None:
    """Run `mkdaemon`."""
    from mkdaemon.cli.mkdaemon.commands import ABOUT, COMMANDS

    if not _shows_help("mkdaemon", ABOUT, COMMANDS):
        from mkdaemon.cli.mkdaemon.app import main

        main()


def mkctl() -> None:
    """Run `mkctl`."""
    from mkdaemon.cli.mkctl.commands import ABOUT, COMMANDS

    if not _shows_help("mkctl", ABOUT, COMMANDS):
        from mkdaemon.cli.mkctl.app import main

        main()


def _shows_help(program: str, about: str, table: tuple[CommandEntry, ...]) -> bool:
    """Print the list or the help of a command, where one is asked for and no library is needed for it."""
    if asks_for_list(sys.argv[1:]):
        text = "\n".join(list_lines(program, about, table))
    elif (stored := stored_help(program, sys.argv[1:])) is not None:
        text = stored
    else:
        return False
    print_help(text)
    return True
