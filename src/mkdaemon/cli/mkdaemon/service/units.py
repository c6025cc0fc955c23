"""The units of systemd: the samples in configs/systemd/, for another folder of the programs.

The guard has no unit: the daemon starts it and hands it the open port, and `KillMode=process` lets it outlive
the daemon until the aircraft is released.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mkdaemon.config.reader import samples_folder

MARK: Final = "# Written by `mkdaemon install-service`; changes belong into `systemctl edit`."
"""First line of every unit: what does not begin so is the user's own."""
SAMPLE: Final = Path("/opt/mkdaemon/.venv/bin")
"""Where the programs of the samples are."""
SETTINGS: Final = Path("/etc/mkdaemon")
UNITS: Final = ("mkdaemon.service", "mkdaemon@.service", "mkdaemon-recorder.service", "mkdaemon-gateway@.service")
"""Every unit."""


def unit_text(name: str, programs: Path = SAMPLE) -> str:
    """What stands in the file of a unit.

    Args:
        name: of the file.
        programs: folder of `mkdaemon` and `mkctl`.
    """
    text = (samples_folder() / "systemd" / name).read_text(encoding="utf-8")
    return text.replace(f"{SAMPLE}/", f"{programs}/").replace(f"{SAMPLE.parent.parent}/", f"{programs.parent.parent}/")


def flies(name: str) -> bool:
    """Whether a unit opens serial lines and cameras, and goes before other programs."""
    return "DeviceAllow=" in unit_text(name)
