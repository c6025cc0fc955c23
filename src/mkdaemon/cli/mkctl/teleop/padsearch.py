"""Pads of this machine: found when they come, with the mapping of their id."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final, Literal

from mkdaemon.cli.mkctl.teleop.evdevpad import EvdevPad, FoundPad, new_paths, open_pad
from mkdaemon.cli.mkctl.teleop.mappings import find_mapping, load_mappings
from mkdaemon.cli.mkctl.teleop.session import TeleopSession
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.errors import ConfigError, MkError

LOOKING: Final = 0.5
"""Between two looks for pads that came [s]."""

Mode = Literal[1, 2, 3, 4]


class Mappings:
    """Which mapping a pad gets.

    Args:
        given: one for every pad; None where the id says it.
        mode: stick mode in place of the mapping's; None for none.
    """

    def __init__(self, given: Gamepad | None, mode: Mode | None) -> None:
        self._given, self._mode = given, mode
        self._known: list[tuple[Path, Gamepad]] = [] if given is not None else load_mappings()

    def of(self, id_: str, name: str) -> Gamepad:
        """Return the mapping of a pad.

        Raises:
            ConfigError: there is none.
        """
        pad = self._given or find_mapping(id_, name, self._known)
        return pad if self._mode is None else pad.model_copy(update={"mode": self._mode})


async def look_for_pads(session: TeleopSession, mappings: Mappings) -> None:
    """Attach every pad that is present or appears, for ever; a pad without a mapping is reported and left out."""
    left_out: set[str] = set()
    while True:
        present = set(new_paths(()))
        left_out &= present
        # What was plugged in again between two looks has its old path, and is no device of the session any more.
        for path in sorted(present - left_out - session.devices.keys()):
            try:
                pad = open_pad(path, session.reported)
            except OSError as error:
                session.notice = f"{path}: {error.strerror}; is this user in the group `input`?"
                continue
            if pad is None or not _attach(session, pad, mappings):
                left_out.add(path)
        await asyncio.sleep(LOOKING)


def _attach(session: TeleopSession, pad: EvdevPad, mappings: Mappings) -> bool:
    """Attach a pad; False where it has no mapping."""
    try:
        mapping = mappings.of(pad.id, pad.facts.name)
    except ConfigError as error:
        pad.close()
        session.notice = str(error)
        return False
    session.attach(pad, mapping)
    return True


def describe(path: str) -> FoundPad | None:
    """Say what a device file is; None where it is not a gamepad."""
    try:
        pad = open_pad(path, lambda *_: None)
    except OSError as error:
        return FoundPad(path, "?", "", f"cannot be opened: {error.strerror}")
    if pad is None:
        return None
    pad.close()
    return FoundPad(path, pad.facts.name, pad.id)


def only_pad(report_to: asyncio.Event) -> EvdevPad:
    """Open the one pad of this machine.

    Args:
        report_to: is set when it reports something.

    Raises:
        MkError: there is none, or more than one.
    """
    pads = []
    for path in new_paths(()):
        try:
            pad = open_pad(path, lambda *_: report_to.set())
        except OSError:
            continue
        if pad is not None:
            pads.append(pad)
    if len(pads) == 1:
        return pads[0]
    for pad in pads:
        pad.close()
    found = f"there are {', '.join(pad.facts.name for pad in pads)}: leave one" if pads else "no pad: plug one in"
    raise MkError(f"{found}; `mkctl teleop --list` shows what this user may open")
