"""The mapping files of pads: those that come with mkdaemon, and those that `mkctl teleop --learn` wrote."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from mkdaemon.cli.mkctl.teleop.devices import Device
from mkdaemon.client.teleop.learning import (
    BUTTONS,
    STICKS,
    LearningQuestion,
    is_calm,
    mapping_text,
    moved_axis,
    pressed_control,
)
from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.gamepadfiles import own_folder, shipped_folder
from mkdaemon.config.reader import load_section
from mkdaemon.errors import ConfigError, MkError
from mkdaemon.files import save

LEARN: Final = "`mkctl teleop --learn` writes one by asking for each stick, `--mapping FILE` uses one"


def load_mappings() -> list[tuple[Path, Gamepad]]:
    """Read every mapping file, those of this machine first.

    Raises:
        ConfigError: one of them is wrong; names file, line, key and fix.
    """
    folders = (own_folder(), shipped_folder())
    paths = [path for folder in folders if folder.is_dir() for path in sorted(folder.glob("*.toml"))]
    return [(path, load_section(Gamepad, path)) for path in paths]


def find_mapping(id_: str, name: str, known: list[tuple[Path, Gamepad]]) -> Gamepad:
    """Return the mapping of a pad.

    Args:
        id_: vendor and product, `045e:028e`.
        name: as the pad calls itself.
        known: from `load_mappings`.

    Raises:
        ConfigError: there is none; says what to do.
    """
    for _, pad in known:
        if id_ in pad.ids:
            return pad
    raise ConfigError(f"no mapping for {name} ({id_}): {LEARN}")


LOOKING: Final = 0.02
"""Between two looks at the pad [s]."""
STICK_PATIENCE: Final = 30.0
"""Longest wait for a stick, and for the enable button [s]."""
BUTTON_PATIENCE: Final = 6.0
"""A button that is not pressed within this time is left out [s]."""
HELD: Final = 0.15
"""A control counts when it has not moved for this time [s]."""


class Learner:
    """Asks one pad.

    Args:
        device: the pad.
        id_: vendor and product.
        show: shows a line.
    """

    def __init__(self, device: Device, id_: str, show: Callable[[str], None]) -> None:
        self._device, self._id, self._show = device, id_, show
        self._loop = asyncio.get_running_loop()
        self._answers: dict[str, str] = {}

    async def learn(self) -> str:
        """Ask for everything; return the text of the mapping file.

        Raises:
            MkError: a stick or the enable button was not shown, or the pad is gone.
        """
        self._show(f"{self._device.facts.name} ({self._id}): release all controls")
        await asyncio.sleep(1.0)
        for question in STICKS:
            await self._ask(question, STICK_PATIENCE, is_stick=True)
        self._show("buttons: one that you do not want is left out after 6 s")
        for question in BUTTONS:
            patience = STICK_PATIENCE if question.key == "enable" else BUTTON_PATIENCE
            await self._ask(question, patience, is_stick=False)
        return mapping_text(self._device.facts.name, self._id, self._answers)

    async def _ask(self, question: LearningQuestion, patience: float, *, is_stick: bool) -> None:
        rest, buttons_rest = self._read()
        self._show(f"  {question.words}")
        ends = self._loop.time() + patience
        since, last = 0.0, ""
        while self._loop.time() < ends:
            await asyncio.sleep(LOOKING)
            axes, buttons = self._read()
            found = moved_axis(rest, axes) if is_stick else pressed_control(rest, axes, buttons_rest, buttons)
            if found is None or found != last:
                since, last = self._loop.time(), found or ""
            elif self._loop.time() - since >= HELD:
                if self._is_taken(found):
                    self._show(f"    {found} is already used: choose another one")
                else:
                    self._answers[question.key] = found
                    self._show(f"    {found}; release it")
                    await self._wait_for_rest(rest)
                    return
                await self._wait_for_rest(rest)
        if is_stick or question.key == "enable":
            raise MkError(f"nothing moved within {patience:g} s: {question.words}")
        self._show("    left out")

    def _is_taken(self, control: str) -> bool:
        """Whether a control, or the axis it is a half of, has a meaning already."""
        axes = {answer.removeprefix("-") for key, answer in self._answers.items() if key in {q.key for q in STICKS}}
        return control in self._answers.values() or control.removeprefix("-").rstrip("+-") in axes

    async def _wait_for_rest(self, rest: dict[str, float]) -> None:
        """Wait until all controls are released; a stick without a spring stays where it is."""
        ends = self._loop.time() + 3.0
        while self._loop.time() < ends:
            axes, buttons = self._read()
            if is_calm(rest, axes, buttons):
                return
            await asyncio.sleep(LOOKING)

    def _read(self) -> tuple[dict[str, float], frozenset[str]]:
        """Axes, -1..1, and pressed buttons."""
        state = self._device.ask(self._loop.time())
        values = {} if state is None else state.values
        ranges = self._device.facts.ranges
        axes = {name: ranges[name].normalise(value) for name, value in values.items() if name in ranges}
        return axes, frozenset(name for name, value in values.items() if name not in ranges and value)


def save_mapping(folder: Path, name: str, text: str) -> Path:
    """Write a mapping file under the name of its pad, over an older one, and read it back.

    Raises:
        MkError: it cannot be written, or is not a mapping.
    """
    word = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40] or "gamepad"
    path = folder / f"{word}.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MkError(f"{folder}: {error.strerror}") from error
    save(path, text, overwrite=True)
    load_section(Gamepad, path)
    return path
