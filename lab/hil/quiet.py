"""What a process of the proving ground does not print, and threads it does not start."""

from __future__ import annotations

import ctypes
import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import structlog


def be_quiet() -> None:
    """Print no events of the daemon; let images be worked on by this thread alone."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    cv2.setNumThreads(1)  # a copy of the process would wait for threads that it has not got


@contextmanager
def aside() -> Iterator[None]:
    """Print on stderr what a library in C prints on stdout meanwhile: stdout may be JSON."""
    c = ctypes.CDLL(None)
    sys.stdout.flush()
    c.fflush(None)
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        yield
    finally:
        c.fflush(None)  # what it keeps in its buffer would come out later, on stdout
        os.dup2(kept, 1)
        os.close(kept)
