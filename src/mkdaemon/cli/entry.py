"""Entry points of the installed programs: Ctrl-C ends them from the first moment, silently, while they still import."""

# Built into the interpreter: importing `signal` itself takes long enough for an interrupt to show a traceback.
import _signal  # type: ignore[import-not-found]

_signal.signal(_signal.SIGINT, _signal.SIG_DFL)

import os  # noqa: E402
import sys  # noqa: E402

from mkdaemon.cli.listing import asks_for_list, print_list  # noqa: E402

# Pydantic looks through every installed package for a plugin; nothing here uses one.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")


def mkdaemon() -> None:
    """Run `mkdaemon`."""
    from mkdaemon.cli.mkdaemon.commands import ABOUT, COMMANDS

    if asks_for_list(sys.argv[1:]):
        print_list("mkdaemon", ABOUT, COMMANDS)
        return
    from mkdaemon.cli.mkdaemon.app import main

    main()


def mkctl() -> None:
    """Run `mkctl`."""
    from mkdaemon.cli.mkctl.commands import ABOUT, COMMANDS

    if asks_for_list(sys.argv[1:]):
        print_list("mkctl", ABOUT, COMMANDS)
        return
    from mkdaemon.cli.mkctl.app import main

    main()
