"""Pictures of rich: tables, bars, colours. What others wrote is only text in them: no markup, no emoji, no escapes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from rich.console import Console as RichConsole
from rich.segment import Segment

from mkdaemon.cli.terminal import spelled

if TYPE_CHECKING:
    from rich.progress import Progress


class Console(RichConsole):
    """A console whose colours and movements are ours alone."""

    def __init__(self, *, stderr: bool = False, file: TextIO | None = None, width: int | None = None) -> None:
        """Draw on standard output.

        Args:
            stderr: on standard error in its place.
            file: on this in its place.
            width: columns; those of the terminal by default.
        """
        super().__init__(stderr=stderr, file=file, width=width, markup=False, emoji=False, highlight=False)

    def _render_buffer(self, buffer: Iterable[Segment]) -> str:
        parts = (part if part.control else part._replace(text=spelled(part.text)) for part in buffer)
        return super()._render_buffer(parts)


@contextmanager
def progress_bars(left: str = "", *more: str, quiet: bool = False) -> Iterator[Progress]:
    """Bars on standard error while the context lasts; nothing when `quiet`, or no terminal is there.

    Args:
        left: what stands before every bar.
        more: what stands behind it, in columns, after the time that is left; `{task.description}` and the like.
        quiet: show nothing.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    words = (TextColumn(one, markup=False) for one in more)
    columns = (TextColumn(left, markup=False), BarColumn(), TimeRemainingColumn(), *words)
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bars:
        yield bars
