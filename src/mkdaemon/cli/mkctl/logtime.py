"""Moments in recordings as people write them, and where recordings are."""

from __future__ import annotations

import os
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from mkdaemon.errors import ConfigError
from mkdaemon.files import user_folder

SERVICE_FOLDER: Final = Path("/var/lib/mkdaemon")
"""Where the daemon's service keeps its state."""


def recording_folders() -> list[Path]:
    """Where daemons and recorders of this machine write, as far as this user may look."""
    found: list[Path] = []
    places = [SERVICE_FOLDER]
    with suppress(ConfigError):  # a user without a home has no such folder
        places.append(user_folder("XDG_STATE_HOME"))
    for place in places:
        found += sorted(path for path in place.glob("*/recordings") if os.access(path, os.R_OK))
    return found


def moment_of(text: str | None, file: Path, option: str) -> int | None:
    """A moment [ns; times of the file].

    Args:
        text: seconds from the beginning, negative from the end, or a time in ISO 8601; None for none.
        file: the recording.
        option: where it was given.

    Raises:
        ConfigError: it is none of these.
        MkError: the recording cannot be read.
    """
    if text is None:
        return None
    from mkdaemon.record.reader import Recording
    from mkdaemon.stamp import nanoseconds

    try:
        seconds = float(text)
    except ValueError:
        try:
            time = datetime.fromisoformat(text)
        except ValueError:
            msg = f"{option} {text!r}: give seconds from the beginning, -10 for the end, or 2026-11-22T08:00:00Z"
            raise ConfigError(msg) from None
        return nanoseconds((time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp())
    if seconds != seconds or abs(seconds) > 1e9:
        raise ConfigError(f"{option} {text!r}: no time of this recording")
    first, last = Recording(file).span()
    return (last if text.startswith("-") else first) + nanoseconds(seconds)
