"""Entry points of the installed programs: Ctrl-C ends them from the first moment, silently, while they still import."""

from __future__ import annotations

import signal
from typing import NoReturn


def mkdaemon() -> NoReturn:
    """Run `mkdaemon`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from mkdaemon.cli.mkdaemon.app import main

    main()


def mkctl() -> NoReturn:
    """Run `mkctl`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from mkdaemon.cli.mkctl.app import main

    main()
