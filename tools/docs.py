"""`python -m tools.docs`: the pages and sources that are made from tables, written or compared.

A page is made by a function that takes the root of the source tree and returns the whole text. To add one, add a line
to `GENERATED`, or to `FILLED` where only its tables are made.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Final

from cyclopts import App, Parameter

from mkdaemon.cli.program import run
from mkdaemon.errors import MkError
from mkdaemon.files import write_whole
from tools.markdown import Filled

GENERATED: Final[Mapping[str, str]] = {
    "src/mkdaemon/cli/help.json": "tools.help_texts:help_texts",
    "src/mkdaemon/client/keytree.py": "tools.client_sources:key_tree",
    "src/mkdaemon/client/setpointcalls.py": "tools.client_sources:setpoint_calls",
    "src/mkdaemon/client/verbcalls.py": "tools.client_sources:verb_calls",
    "configs/zenoh/client-tls.json5": "tools.zenoh_samples:client",
    "configs/zenoh/daemon-tls.json5": "tools.zenoh_samples:daemon",
    "docs/library-reference.md": "tools.library_page:library_page",
}
"""Page or source, relative to the root of the source tree, and the function that makes it, imported when needed."""


FILLED: Final[Mapping[str, Filled]] = {
    "docs/configuration.md": Filled("tools.configuration_page"),
    "docs/keys.md": Filled("tools.keys_page"),
    "docs/lab/accuracy.md": Filled("tools.accuracy_tables", "docs/results/vision.json"),
    "docs/lab/genuine-triggers.md": Filled("tools.genuine_tables", "docs/results/genuine.jsonl"),
    "docs/lab/genuine.md": Filled("tools.genuine_tables", "docs/results/genuine.jsonl"),
    "docs/modes.md": Filled("tools.modes_page"),
    "docs/protocol.md": Filled("tools.protocol_page"),
    "docs/troubles.md": Filled("tools.message_tables"),
    "docs/waypoints.md": Filled("tools.items_table"),
}
"""Pages written by hand in which only tables are made; a tree without the page needs none."""


def make_page(page: str, root: Path) -> str:
    """Return the text of a page.

    Args:
        page: of `GENERATED` or `FILLED`.
        root: root of the source tree.
    """
    if page in FILLED:
        return FILLED[page].page(page, root)
    module, _, name = GENERATED[page].partition(":")
    function: Callable[[Path], str] = getattr(importlib.import_module(module), name)
    return function(root)


def _pages(root: Path) -> list[str]:
    """All pages that are made."""
    return [*GENERATED, *(page for page in FILLED if (root / page).is_file())]


def stale_pages(root: Path) -> list[str]:
    """Return the generated pages under `root` that are missing or differ from what would be written."""
    stale = []
    for page in _pages(root):
        path = root / page
        if not path.is_file() or path.read_text(encoding="utf-8") != make_page(page, root):
            stale.append(page)
    return stale


def docs(
    *,
    check: Annotated[bool, Parameter(help="Only compare; exit code 1 when a page is not up to date.")] = False,
    root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path(),
) -> None:
    """Write the generated pages of docs/.

    Raises:
        MkError: there is no docs/ under the root, or a page is not up to date.
    """
    if not (root / "docs").is_dir():
        msg = f"{root.resolve()} has no docs/: run it in the source tree or give --root"
        raise MkError(msg)
    if not check:
        for page in _pages(root):
            (root / page).parent.mkdir(parents=True, exist_ok=True)
            write_whole(root / page, make_page(page, root), overwrite=True)
            print(f"wrote {page}")
        return
    stale = stale_pages(root)
    if stale:
        msg = f"not up to date: {', '.join(stale)}; run `make docs`"
        raise MkError(msg)
    print(f"generated pages up to date: {', '.join(_pages(root))}")


app = App(name="docs", default_command=docs, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
