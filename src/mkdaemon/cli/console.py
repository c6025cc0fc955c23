"""Pictures of rich: tables, bars, colours. What others wrote is only text in them: no markup, no emoji, no escapes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TextIO

from rich.console import Console as RichConsole
from rich.segment import Segment

from mkdaemon.cli.terminal import spelled


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
