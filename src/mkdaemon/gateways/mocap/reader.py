"""A separate process that reads a motion capture system.

`motioncapture` 1.1 holds Python's lock while it connects, and waits without end for a Vicon or OptiTrack system that
does not answer: in the gateway's process neither its health nor a signal would get through. Here the operating system
ends the wait, and the gateway connects again.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any, Final

from mkdaemon.errors import ConfigError
from mkdaemon.gateways.mocap.systems import BodyPose, MocapSystem, find_system, frames_of

PATIENCE: Final = 5.0
"""Longest wait for a measurement, and for the connection [s]."""
LATE: Final = 0.05
"""A measurement that the gateway reads later than this is left out [s]: its age is not in the reports."""


def frames_apart(system: MocapSystem, host: str, patience: float = PATIENCE) -> Iterator[dict[str, BodyPose]]:
    """Connect in another process, and yield every measurement; blocks.

    Args:
        system: kind.
        host: name or address.
        patience: longest wait for a measurement [s].

    Raises:
        ConfigError: the library does not know that kind.
        RuntimeError: the system cannot be reached, or is silent.
    """
    words = [sys.executable, "-m", __name__, system.word, host, str(patience)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, start_new_session=True) as reader:
        assert reader.stdout is not None
        try:
            for line in reader.stdout:
                if not line.startswith(b"{"):  # the library prints, too
                    continue
                found = json.loads(line)
                if "error" in found:
                    raise (ConfigError if found["is_mistake"] else RuntimeError)(found["error"])
                if time.monotonic() - found["at"] <= LATE:
                    bodies = found["bodies"].items()
                    yield {name: BodyPose((x, y, z), (w, i, j, k)) for name, ((x, y, z), (w, i, j, k)) in bodies}
        except GeneratorExit:
            reader.kill()
            raise
    is_silent = reader.returncode == -signal.SIGALRM
    raise RuntimeError(f"no measurement for {patience:g} s" if is_silent else "its reader has ended")


def main(word: str, host: str, patience: float) -> None:
    """Print every measurement as a line of JSON until the system is lost or silent.

    Args:
        word: of the kind of system.
        host: name or address.
        patience: longest wait for a measurement [s].
    """
    with suppress(BrokenPipeError):  # the gateway has ended
        try:
            library = import_module("motioncapture")
            # The default action of SIGALRM ends the process, which needs no lock of Python.
            signal.setitimer(signal.ITIMER_REAL, patience)
            for bodies in frames_of(library, find_system(word), host):
                signal.setitimer(signal.ITIMER_REAL, patience)
                _put(
                    at=time.monotonic(),
                    bodies={name: (each.position, each.quaternion) for name, each in bodies.items()},
                )
        except BrokenPipeError:
            raise
        except (ConfigError, RuntimeError, OSError, ValueError) as error:
            _put(error=str(error), is_mistake=isinstance(error, ConfigError))


def _put(**found: Any) -> None:
    sys.stdout.write(json.dumps(found) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
