"""A page of commands and answers, typed on a desk and compared."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from lab.rigs.desk import Desk

_BLOCK: Final = re.compile(r"^```(?P<language>\w*)\n(?P<text>.*?)^```", re.DOTALL | re.MULTILINE)
_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")
_ANYTHING: Final = "..."


class Block(NamedTuple):
    """What stands between two fences of a page.

    Attributes:
        language: behind the first fence: `sh` is typed, `console` is typed and answered; empty for none.
        text: all of it.
        line: number of its first line in the page, from 1.
    """

    language: str
    text: str
    line: int


class Step(NamedTuple):
    """A command of a page.

    Attributes:
        typed: what is typed, or what happens.
        answer: the lines below it.
        line: number of its line in the page, from 1.
    """

    typed: str
    answer: list[str]
    line: int


def blocks_of(page: Path) -> Iterator[Block]:
    """The blocks of a page."""
    text = page.read_text(encoding="utf-8")
    for found in _BLOCK.finditer(text):
        yield Block(found["language"], found["text"], text.count("\n", 0, found.start("text")) + 1)


def steps_of(page: Path) -> Iterator[Step]:
    """The commands of a page that have answers."""
    for block in blocks_of(page):
        if block.language == "console":
            yield from answered_steps(block)


def answered_steps(block: Block) -> Iterator[Step]:
    """The commands of one block, with their answers."""
    step: Step | None = None
    for number, line in enumerate(block.text.splitlines(), block.line):
        if line.startswith(("$ ", "# ")):
            if step is not None:
                yield step
            step = Step(line.removeprefix("$ "), [], number)
        elif line.strip() and step is not None:
            step.answer.append(line)
    if step is not None:
        yield step


def walk(page: Path, desk: Desk) -> Iterator[str]:
    """Type every command of a page; a sentence for every answer that is another one than the page's."""
    for step in steps_of(page):
        lines = [line for line in desk.type(step.typed).splitlines() if line.strip()]
        if not is_answer(step.answer, lines):
            yield "\n".join([f"$ {step.typed}", *lines, "is not what the page says:", *step.answer])


def is_answer(wanted: Sequence[str], lines: Sequence[str]) -> bool:
    """Whether lines are what a page says.

    Numbers of more than one digit are examples and stand for any other; spaces between words are not compared. `...`
    stands for any lines, or, at the end of a line, for any words.
    """
    if not wanted:
        return not lines
    first, *rest = wanted
    if first == _ANYTHING:
        return any(is_answer(rest, lines[start:]) for start in range(len(lines) + 1))
    return bool(lines) and _is_line(first, lines[0]) and is_answer(rest, lines[1:])


def _is_line(wanted: str, line: str) -> bool:
    expected, found = _plain(wanted), _plain(line)
    if expected.endswith(_ANYTHING):
        return found.startswith(expected.removesuffix(_ANYTHING).rstrip())
    return expected == found


def _plain(line: str) -> str:
    """A line without what may be another one."""
    numberless = _NUMBER.sub(lambda found: found[0] if len(found[0]) == 1 else "N", line)
    return " ".join(numberless.replace("-N", "N").replace("+N", "N").split())
