"""`python -m tools.site`: the documentation as a static site, in build/site.

The pages of docs/, the README and the examples are laid out in build/pages, with their links, as `mkdocs.yml` expects
them; `zensical` (`make site` installs it) builds the site and stops at every link or anchor that leads nowhere. Pages
of docs/lab/ are for those who change the code: they stay in the repository, and the site names their files.
"""

from __future__ import annotations

import posixpath
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import Annotated, Final

from cyclopts import App, Parameter

from mkdaemon.cli.program import run
from mkdaemon.errors import MkError

TABLE: Final = "mkdocs.yml"
"""The settings of the site with its navigation."""
STAGE: Final = "build/pages"
SITE: Final = "build/site"
FRONT: Final = {"README.md": "index.md"}
"""Pages outside docs/ whose place in the site has another name."""
OUTSIDE: Final = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
"""Pages outside docs/ that the site has too."""
LAB: Final = "docs/lab/"
"""Pages of the repository that are not in the site."""
EXAMPLES: Final = "examples.md"
"""The page made of the programs in examples/."""
LINK: Final = re.compile(r"(?P<head>(?:\[(?P<words>[^\]\n]*))?\]\()(?P<target>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)")
REFERENCE: Final = "\n  - Reference:\n"
"""Begins the part of the navigation whose pages are looked up in, not read."""
_ENTRY: Final = re.compile(r"^ +- (?:[^:\n]+: )?(?P<page>[\w/-]+\.md)$", re.MULTILINE)
_CODE: Final = re.compile(r"(?<!<pre>)(?<!</span>)<code>(?P<words>[^<]*)</code>")
_PRINTED: Final = re.compile(r"(?<=<code>)(?:(?!</code>).)*(?=</code></pre>)", re.DOTALL)
_DRAWN: Final = re.compile(r"^.*[\u2500-\u257f].*$", re.MULTILINE)
"""A line of a printed table; the range holds Unicode's box drawing characters."""
_BREAKABLE: Final = re.compile(r"\S*[-/]\S*")
_LONGEST_WORD: Final = 40
"""Letters of a word that fits into one line of a telephone."""
_ABROAD: Final = re.compile(r"^[a-z]+:")


def pages_in_navigation(root: Path) -> list[str]:
    """Return the pages that the navigation of `mkdocs.yml` lists, in its order, as places in the site."""
    return [entry["page"] for entry in _ENTRY.finditer((root / TABLE).read_text(encoding="utf-8"))]


def pages_for_users(root: Path) -> list[str]:
    """Return the pages that the navigation lists before its part for reference, as paths relative to the root."""
    listed = (root / TABLE).read_text(encoding="utf-8").partition(REFERENCE)[0]
    outside = {place: page for page, place in FRONT.items()}
    pages = (entry["page"] for entry in _ENTRY.finditer(listed))
    return [outside.get(page, f"docs/{page}") for page in pages]


def place_in_site(path: str) -> str:
    """Return where a file of the tree stands in the site.

    Args:
        path: relative to the root, with slashes.
    """
    if path == "examples" or PurePosixPath(path).parent == PurePosixPath("examples"):
        return EXAMPLES
    return FRONT.get(path) or path.removeprefix("docs/")


def moved(text: str, page: str, titles: Mapping[str, str]) -> str:
    """Return the text of a page with its relative links as they must be in the site.

    Args:
        text: as it stands in the tree.
        page: its path relative to the root, with slashes.
        titles: of the pages, by their paths: a link whose words are the name of a file shows the page's title.
    """
    here = posixpath.dirname(place_in_site(page))

    def link(found: re.Match[str]) -> str:
        if _ABROAD.match(found["target"]):
            return found[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(page), found["target"]))
        anchor, words = found["anchor"] or "", found["words"]
        if path.startswith(LAB):
            return f"`{path}`" if words.endswith(".md") else f"{words} (`{path}`)"
        if path.startswith("examples/"):
            anchor = f"#{PurePosixPath(path).stem}"
        head = f"[{titles[path]}](" if words and words.endswith(".md") and path in titles else found["head"]
        return f"{head}{posixpath.relpath(place_in_site(path), here or '.')}{anchor})"

    return LINK.sub(link, text)


def pages_of(root: Path) -> list[str]:
    """Return the pages of the tree that the site has, relative to the root, with slashes."""
    pages = (path.relative_to(root).as_posix() for path in sorted((root / "docs").rglob("*.md")))
    return [*OUTSIDE, *(page for page in pages if not page.startswith(LAB))]


def titles_of(root: Path) -> dict[str, str]:
    """Return the title of each page, by its path relative to the root."""
    texts = {page: (root / page).read_text(encoding="utf-8") for page in pages_of(root)}
    return {page: text.partition("\n")[0].removeprefix("# ") for page, text in texts.items()}


def examples_page(root: Path) -> str:
    """Return the page of the programs in examples/."""
    parts = ["# Examples\n\nWhole programs to copy. The tests run them as they stand here.\n"]
    for source in sorted((root / "examples").glob("*.py")):
        text = source.read_text(encoding="utf-8")
        parts.append(f"## {source.name} {{ #{source.stem} }}\n\n```python\n{text}```\n")
    return "\n".join(parts)


def lay_out(root: Path) -> Path:
    """Write the pages as the site has them, and return their folder."""
    stage = root / STAGE
    shutil.rmtree(stage, ignore_errors=True)
    titles = titles_of(root)
    for page in titles:
        _write(stage / place_in_site(page), moved((root / page).read_text(encoding="utf-8"), page, titles))
    _write(stage / EXAMPLES, examples_page(root))
    for folder in ("figures", "site"):
        shutil.copytree(root / "docs" / folder, stage / folder)
    return stage


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def build(root: Path, call: Callable[..., subprocess.CompletedProcess[str]] = subprocess.run) -> None:
    """Build the site of the pages that are laid out.

    Raises:
        MkError: zensical is not installed, or found a link, an anchor or a page that does not exist.
    """
    program = Path(sys.executable).with_name("zensical")
    if not program.exists():
        msg = f"there is no {program.name} in {program.parent}: `make site` installs it"
        raise MkError(msg)
    shutil.rmtree(root / SITE, ignore_errors=True)
    done = call([program, "build", "--clean", "--strict"], cwd=root, text=True, capture_output=True, check=False)
    if done.returncode or not (root / SITE / "index.html").is_file():
        found = re.sub(r"\x1b\[[\d;]*m", "", done.stdout + done.stderr).split("Traceback")[0]
        msg = f"the site was not built:\n{found.strip()}"
        raise MkError(msg)


def keep_words_whole(page: str) -> str:
    """Return the HTML of a page in which no browser breaks a word of a command or a key at its hyphen or slash."""

    def word(found: re.Match[str]) -> str:
        return found[0] if len(found[0]) > _LONGEST_WORD else f'<span class="word">{found[0]}</span>'

    return _CODE.sub(lambda code: f"<code>{_BREAKABLE.sub(word, code['words'])}</code>", page)


def keep_tables_whole(page: str) -> str:
    """Return the HTML of a page in which printed tables do not wrap: `site.css` wraps the other lines of a block."""
    return _PRINTED.sub(lambda block: _DRAWN.sub(r'<span class="drawn">\g<0></span>', block[0]), page)


def site(*, root: Annotated[Path, Parameter(help="Root of the source tree.")] = Path()) -> None:
    """Build the site of the documentation.

    Raises:
        MkError: there is no mkdocs.yml under the root, or the site cannot be built.
    """
    if not (root / TABLE).is_file():
        msg = f"{root.resolve()} has no {TABLE}: run it in the source tree or give --root"
        raise MkError(msg)
    stage = lay_out(root)
    build(root)
    for page in (root / SITE).rglob("*.html"):
        page.write_text(keep_tables_whole(keep_words_whole(page.read_text(encoding="utf-8"))), encoding="utf-8")
    print(f"built {root / SITE / 'index.html'} of {len(list(stage.rglob('*.md')))} pages")


app = App(name="site", default_command=site, default_parameter=Parameter(negative=()))

if __name__ == "__main__":
    sys.exit(run(app))
