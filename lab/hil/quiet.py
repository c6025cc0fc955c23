"""What a process of the proving ground does not print, and threads it does not start."""

from __future__ import annotations

import logging

import cv2
import structlog


def be_quiet() -> None:
    """Print no events of the daemon; let images be worked on by this thread alone."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    cv2.setNumThreads(1)  # a copy of the process would wait for threads that it has not got
