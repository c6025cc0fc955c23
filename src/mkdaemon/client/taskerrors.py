"""The error that ended a group of tasks, as the one line that a user reads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mkdaemon.errors import MkError


@contextmanager
def single_error() -> Iterator[None]:
    """Raise the first error of a group of tasks in place of the group; a defect keeps its group and its traceback.

    Raises:
        MkError: the first one of a group in which all are such errors.
    """
    try:
        yield
    except BaseExceptionGroup as group:
        known, others = group.split(MkError)
        if known is None or others is not None:
            raise
        error: BaseException = known
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        raise error from None
