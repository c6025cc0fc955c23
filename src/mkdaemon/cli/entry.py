"""Entry points of the installed programs: Ctrl-C ends them from the first moment, silently, while they still import."""

# Built into the interpreter: importing `signal` itself takes long enough for an interrupt to show a traceback.
import _signal  # type: ignore[import-not-found]

_signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from typing import NoReturn  # noqa: E402


def mkdaemon() -> NoReturn:
    """Run `mkdaemon`."""
    from mkdaemon.cli.mkdaemon.app import main

    main()


def mkctl() -> NoReturn:
    """Run `mkctl`."""
    from mkdaemon.cli.mkctl.app import main

    main()
