"""How a mapping is learned: which control moved when the user was asked to move one, and the file that follows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from mkdaemon.client.teleop.hands import Function

MOVED: Final = 0.5
"""An axis counts as moved at this distance from its rest, share of its whole way, -1..1."""
CALM: Final = 0.15
"""An axis this close to where it rested is at rest again."""


class LearningQuestion(NamedTuple):
    """One thing that the user is asked to move.

    Attributes:
        key: in the mapping.
        words: what to do.
    """

    key: str
    words: str


STICKS: Final = (
    LearningQuestion("left_y", "push the LEFT stick UP, away from you"),
    LearningQuestion("left_x", "push the LEFT stick to the RIGHT"),
    LearningQuestion("right_y", "push the RIGHT stick UP, away from you"),
    LearningQuestion("right_x", "push the RIGHT stick to the RIGHT"),
)
"""The four axes, each in its positive direction."""
_WORDS: Final = {
    Function.ENABLE: "ENABLE, held while you fly",
    Function.RECENTRE: "RE-CENTRE hover thrust",
    Function.TAKEOFF: "TAKE-OFF",
    Function.RELEASE: "RELEASE, at once",
    Function.STOP: "STOP the motors",
}
BUTTONS: Final = tuple(
    LearningQuestion(each.value, f"press the button for {_WORDS.get(each, each.value.replace('_', ' ').upper())}")
    for each in Function
)
"""The buttons; only the first must be answered."""


def moved_axis(rest: Mapping[str, float], now: Mapping[str, float]) -> str | None:
    """Return the axis that moved most, with `-` in front where it grew smaller; None where none moved enough.

    Args:
        rest: axes before, -1..1.
        now: axes now.
    """
    name = max(now, key=lambda axis: abs(now[axis] - rest.get(axis, 0.0)), default=None)
    if name is None:
        return None
    way = now[name] - rest.get(name, 0.0)
    if abs(way) < MOVED:
        return None
    return name if way > 0.0 else f"-{name}"


def pressed_control(
    rest: Mapping[str, float], now: Mapping[str, float], buttons_rest: frozenset[str], buttons: frozenset[str]
) -> str | None:
    """Return the button that was pressed, or the half of an axis that was; None for neither.

    Args:
        rest: axes before, -1..1.
        now: axes now.
        buttons_rest: buttons pressed before.
        buttons: buttons pressed now.
    """
    if pressed := buttons - buttons_rest:
        return min(pressed)
    axis = moved_axis(rest, now)
    if axis is None:
        return None
    return f"{axis.removeprefix('-')}{'-' if axis.startswith('-') else '+'}"


def is_calm(rest: Mapping[str, float], now: Mapping[str, float], buttons: frozenset[str]) -> bool:
    """Whether everything is as it was at rest."""
    return not buttons and all(abs(value - rest.get(axis, 0.0)) < CALM for axis, value in now.items())


def mapping_text(name: str, id_: str, answers: Mapping[str, str]) -> str:
    """Return the mapping file.

    Args:
        name: of the pad.
        id_: vendor and product.
        answers: controls by key of `STICKS` and `BUTTONS`.
    """
    plain = "".join(letter if letter.isprintable() and letter not in '"\\' else " " for letter in name)[:60].strip()
    lines = ["# Written by `mkctl teleop --learn`.", "", f'name = "{plain or "gamepad"}"', f'ids = ["{id_}"]', ""]
    for section, questions in (("sticks", STICKS), ("buttons", BUTTONS)):
        lines.append(f"[{section}]")
        lines += [f'{question.key} = "{answers[question.key]}"' for question in questions if question.key in answers]
        lines.append("")
    return "\n".join(lines)
