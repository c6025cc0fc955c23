"""Faults of a gateway's own: each ends the one message or value that met it, and is counted and logged."""

from __future__ import annotations

import struct
from collections.abc import Awaitable, Iterator
from contextlib import contextmanager

import structlog

from mkdaemon.errors import MkError


class Faults:
    """Ends what fails without ending the gateway.

    Attributes:
        count: faults since the start.
    """

    def __init__(self, gateway: str) -> None:
        """Have met none.

        Args:
            gateway: name of it, for the log.
        """
        self.count = 0
        self._log = structlog.get_logger(f"gateway.{gateway}")
        self._logged: set[tuple[str, str]] = set()

    def note(self, what: str, error: Exception) -> None:
        """Count a fault; the first of each place and kind is logged with its traceback.

        Args:
            what: name of the message or of the work that failed.
            error: what was raised.
        """
        self.count += 1
        kind = (what, type(error).__name__)
        if kind not in self._logged:
            self._logged.add(kind)
            self._log.error("dropped: a defect of the gateway", what=what, exc_info=error)

    @contextmanager
    def contained(self, what: str) -> Iterator[None]:
        """Drop what fails inside.

        Args:
            what: name of the message or of the work.
        """
        try:
            yield
        except Exception as error:  # noqa: BLE001  # whatever a message does, it ends that message only
            self.note(what, error)

    async def contain(self, what: str, work: Awaitable[None]) -> None:
        """Do some work, and drop it where it fails.

        Args:
            what: name of the message or of the work.
            work: what is awaited.
        """
        with self.contained(what):
            await work


@contextmanager
def expressible(suffix: str, vehicle: str, wall: float) -> Iterator[None]:
    """Name a recorded value that no message of another program can hold, where an export would fail inside.

    Args:
        suffix: of the key of the value.
        vehicle: whose it is.
        wall: its time [s; Unix time].

    Raises:
        MkError: it fails; another `MkError` is raised as it is.
    """
    try:
        yield
    except MkError:
        raise
    except (ArithmeticError, TypeError, ValueError, RuntimeError, struct.error) as error:
        msg = f"{suffix} of {vehicle} at {wall:.3f} fits in no message ({error}); --format csv takes every value"
        raise MkError(msg) from error
