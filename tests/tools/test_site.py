"""The site has every page of the tree once, and every link in it leads to a page, a picture or an example."""

from __future__ import annotations

import posixpath
import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from mkdaemon.cli.program import run
from mkdaemon.errors import MkError
from tests.places import DOCS, ROOT
from tools import site
from tools.site import (
    EXAMPLES,
    app,
    build,
    examples_page,
    keep_tables_whole,
    keep_words_whole,
    moved,
    pages_in_navigation,
    pages_of,
    place_in_site,
    titles_of,
)

PLACES = [*(place_in_site(page) for page in pages_of(ROOT)), EXAMPLES]


def test_every_page_stands_in_the_navigation_once():
    listed = Counter(pages_in_navigation(ROOT))
    unlisted = [page for page in PLACES if page not in listed]
    assert unlisted == [], "give it a line in the navigation of mkdocs.yml"
    assert [page for page in listed if page not in PLACES] == [], "mkdocs.yml names a page that is not there"
    assert [page for page, count in listed.items() if count > 1] == []


def test_every_link_leads_to_a_page_or_a_picture():
    there = {*PLACES, *(path.relative_to(DOCS).as_posix() for path in (DOCS / "figures").iterdir())}
    assert not any(page.startswith("lab/") for page in there)
    lost = []
    for page in pages_of(ROOT):
        text, here = moved((ROOT / page).read_text(encoding="utf-8"), page, {}), posixpath.dirname(place_in_site(page))
        targets = re.findall(r"\]\((?![a-z]+:|#)([^)#\s]+)", text)
        lost += [f"{page}: {to}" for to in targets if posixpath.normpath(posixpath.join(here, to)) not in there]
    assert lost == []


@pytest.mark.parametrize(
    ("page", "link", "expected"),
    [
        ("README.md", "[a](docs/safety.md)", "[a](safety.md)"),
        ("README.md", "![a](docs/figures/view.png)", "![a](figures/view.png)"),
        ("docs/safety.md", "[a](lab/stories.md#b)", "a (`docs/lab/stories.md`)"),
        ("docs/safety.md", "[lab/stories.md](lab/stories.md)", "`docs/lab/stories.md`"),
        ("docs/architecture.md", "[a](../CONTRIBUTING.md#commits)", "[a](CONTRIBUTING.md#commits)"),
        ("docs/library.md", "[a](../examples)", "[a](examples.md)"),
        ("docs/library.md", "[a](../examples/fly_square.py)", "[a](examples.md#fly_square)"),
        ("docs/safety.md", "[a](https://zenoh.io) [b](#the-guard)", "[a](https://zenoh.io) [b](#the-guard)"),
    ],
)
def test_a_link_is_moved_with_its_page(page, link, expected):
    assert moved(link, page, {}) == expected


@pytest.mark.parametrize(
    ("link", "expected"),
    [
        ("see [safety.md](safety.md)", "see [Safety](safety.md)"),
        ("see [the ladder](safety.md), [other.md](other.md)", "see [the ladder](safety.md), [other.md](other.md)"),
    ],
)
def test_a_link_named_as_a_file_shows_the_title_of_its_page(link, expected):
    titles = {"docs/safety.md": "Safety"}
    assert moved(link, "docs/flying.md", titles) == expected


def test_every_page_begins_with_its_title():
    titles = titles_of(ROOT)
    assert [page for page, title in titles.items() if not title or title.startswith(("#", "<"))] == []
    assert titles["docs/safety.md"] == "Safety"


def test_every_example_has_its_heading():
    page = examples_page(ROOT)
    assert all(f"## {source.name} {{ #{source.stem} }}" in page for source in (ROOT / "examples").glob("*.py"))


def test_what_the_builder_says_is_told_without_its_traceback(tmp_path, monkeypatch):
    monkeypatch.setattr(site.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(MkError, match="make site"):
        build(tmp_path)
    (tmp_path / "zensical").touch()

    def complains(command, **_):
        return subprocess.CompletedProcess(
            command, 1, "\x1b[33mWarning:\x1b[0m page does not exist\n", "Traceback (most"
        )

    with pytest.raises(MkError) as told:
        build(tmp_path, complains)
    assert str(told.value) == "the site was not built:\nWarning: page does not exist"


@pytest.mark.parametrize(
    ("html", "whole"),
    [
        ("<code>mkctl fly</code>", "<code>mkctl fly</code>"),
        ("<code>mkctl take-off 2</code>", '<code>mkctl <span class="word">take-off</span> 2</code>'),
        ("<pre><span></span><code>a-b</code></pre>", "<pre><span></span><code>a-b</code></pre>"),
        ("<p>a-b</p>", "<p>a-b</p>"),
        (f"<code>{'a-' * 21}</code>", f"<code>{'a-' * 21}</code>"),
    ],
)
def test_a_word_of_a_command_is_not_broken(html, whole):
    assert keep_words_whole(html) == whole


def test_only_lines_of_a_printed_table_are_kept_from_wrapping():
    html = "<pre><span></span><code>$ mkctl preflight\n<i>│ disk │ full │</i>\nnot ready\n</code></pre><code>│</code>"
    kept = keep_tables_whole(html)
    assert kept == html.replace("<i>│ disk │ full │</i>", '<span class="drawn"><i>│ disk │ full │</i></span>')


def test_a_folder_without_a_navigation_is_refused(capsys, tmp_path):
    assert run(app, ["--root", str(tmp_path)]) == 1
    assert "has no mkdocs.yml" in capsys.readouterr().err
    assert not Path(tmp_path / "build").exists()
