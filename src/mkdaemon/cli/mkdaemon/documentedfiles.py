"""Every kind of configuration file, declared once: for docs/configuration.md and for `mkdaemon config explain`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

from mkdaemon.cli.mkdaemon.extraprograms import file_with
from mkdaemon.config.base import Section
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.keys import ConfigKey, about_section, heading_of, keys_of
from mkdaemon.config.root import DaemonSections
from mkdaemon.config.vision import TargetFile


class DocumentedFile(NamedTuple):
    """One kind of file.

    Attributes:
        title: what it is called.
        model: what reads it.
        about: who names it, and what writes it; empty for the aircraft's own file.
    """

    title: str
    model: type[Section]
    about: str = ""

    def sections(self) -> Mapping[str, Sequence[ConfigKey]]:
        """The keys of each section, in the order of the file; the top of the file has an empty name."""
        return _sections_of(self.model)

    def heading(self, section: str) -> str:
        """How a section is written; empty for the top of the file."""
        return heading_of(self.model, section) if section else ""

    def about_section(self, section: str) -> str:
        """What a section is for; of the top of the file, what the file is for."""
        return about_section(self.model, section) if section else self.about


@cache
def _sections_of(model: type[Section]) -> dict[str, list[ConfigKey]]:
    found: dict[str, list[ConfigKey]] = {}
    for key in keys_of(model):
        found.setdefault(key.section, []).append(key)
    return found


def documented_files() -> tuple[DocumentedFile, ...]:
    """Every kind of file; without the simulator its section is left out."""
    from mkdaemon.vision.camera.calibration_file import Camera  # numpy takes longer than everything else here

    return (
        DocumentedFile("The aircraft's file", file_with("sim") or DaemonSections),
        DocumentedFile(
            "A target file",
            TargetFile,
            "Named by `cameras.targets`; `mkdaemon calibrate print` prints it and writes one, `mkdaemon calibrate map`"
            " surveys one.",
        ),
        DocumentedFile(
            "A mapping file of a gamepad",
            Gamepad,
            "Found by `ids`, or named by `mkctl teleop --mapping`; `mkctl teleop --learn` writes it: docs/teleop.md.",
        ),
        DocumentedFile(
            "A camera file", Camera, "Named by `cameras.calibration`; `mkdaemon calibrate camera` writes it."
        ),
    )
