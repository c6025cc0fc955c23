"""Pads of this machine: found when they come, with the mapping of their id."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final, Literal

from mkdaemon.cli.mkctl.teleop.devices import Device
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


def open_pads(paths: Iterable[str], report: Callable[[str, str, float, float], None]) -> Iterator[EvdevPad | FoundPad]:
    """Open device files; those that are no gamepad are left out, and one that cannot be opened says why.

    Args:
        paths: of the files.
        report: see `EvdevPad`.
    """
    for path in paths:
        try:
            pad = open_pad(path, report)
        except OSError as error:
            yield FoundPad(path, "?", "", f"cannot be opened: {error.strerror}")
        else:
            if pad is not None:
                yield pad


async def look_for_pads(session: TeleopSession, mappings: Mappings) -> None:
    """Attach every pad that is present or appears, for ever; a pad without a mapping is reported and left out."""
    left_out: set[str] = set()
    while True:
        present = set(new_paths(()))
        left_out &= present
        # What was plugged in again between two looks has its old path, and is no device of the session any more.
        new = present - left_out - session.devices.keys()
        left_out |= new
        for pad in open_pads(sorted(new), session.reported):
            if isinstance(pad, FoundPad):
                session.notice = f"{pad.path} {pad.trouble}; is this user in the group `input`?"
                left_out.discard(pad.path)
            elif attach(session, pad, pad.id, mappings):
                left_out.discard(pad.name)
            else:
                pad.close()
        await asyncio.sleep(LOOKING)


def attach(session: TeleopSession, device: Device, id_: str, mappings: Mappings) -> bool:
    """Attach a pad; False where it has no mapping, which is reported."""
    try:
        mapping = mappings.of(id_, device.facts.name)
    except ConfigError as error:
        session.notice = str(error)
        return False
    session.attach(device, mapping)
    return True


def describe_pads() -> Iterator[FoundPad]:
    """What the gamepads of this machine are."""
    for pad in open_pads(new_paths(()), lambda *_: None):
        if isinstance(pad, EvdevPad):
            pad.close()
            yield FoundPad(pad.name, pad.facts.name, pad.id)
        else:
            yield pad


def only_pad(report_to: asyncio.Event) -> EvdevPad:
    """Open the one pad of this machine.

    Args:
        report_to: is set when it reports something.

    Raises:
        MkError: there is none, or more than one.
    """
    found = open_pads(new_paths(()), lambda *_: report_to.set())
    pads = [pad for pad in found if isinstance(pad, EvdevPad)]
    if len(pads) == 1:
        return pads[0]
    for pad in pads:
        pad.close()
    names = f"there are {', '.join(pad.facts.name for pad in pads)}: leave one" if pads else "no pad: plug one in"
    raise MkError(f"{names}; `mkctl teleop --list` shows what this user may open")
