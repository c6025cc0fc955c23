"""The signal that troubles a daemon."""

from __future__ import annotations

import signal

from lab.rigs.troubled import TROUBLE
from mkdaemon.cli.mkdaemon.run import RELOAD


def test_the_signal_of_the_lab_is_none_that_the_daemon_takes_for_itself():
    assert TROUBLE not in {RELOAD, signal.SIGINT, signal.SIGTERM}
